"""How long planning takes, and how long the chains are, beside two known planners.

All of them answer the same questions in turn, on the random worlds of ``planning.wavn``; the
larger world has the same number of robots a square metre, so that its chains are long.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from time import perf_counter_ns

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments import stopwatch
from vrchain.experiments.planning.wavn import (
    SIDE_M,
    Path,
    Task,
    World,
    breadth_first,
    ledger_chain,
    random_tasks,
    random_world,
    shorten,
)
from vrchain.navigation.planning.planner import Chain, Planner
from vrchain.seeding import generator

COLUMNS = [*stopwatch.COLUMNS[:2], "landmarks", *stopwatch.COLUMNS[2:]]

# robots, landmarks, side of the world, worlds, and what the median should not exceed
SIZES = (
    (40, 400, SIDE_M, 10, 1_000.0),
    (1_000, 10_000, 5 * SIDE_M, 1, 50_000.0),
)
_SCORE = 0.9  # of every leg, where scores are equal
_ROUTES = 3

Question = Callable[[Task], "Path | Chain | None"]


def bench_planner(n_tasks: int, *, seed: int) -> pd.DataFrame:
    """One row a planner and size of world, with ``COLUMNS``; times in microseconds.

    positions: tasks in all worlds of a size, n_tasks or a few more; landmarks: mean length of its
    chains, the goal among them; reference_us: breadth-first search on the same tasks; ratio: of
    the medians; bar: what the median should not exceed. MissionError without tasks.
    """
    if n_tasks < 1:
        raise MissionError(f"expected 1 task or more to plan for, got {n_tasks}")
    rows = []
    for n_robots, n_landmarks, side_m, n_worlds, bar_us in SIZES:
        asked: list[tuple[str, float, int | None]] = []
        prepare_us = []
        for index in range(n_worlds):
            world = random_world(seed, index, n_robots, n_landmarks, side_m)
            tasks = random_tasks(world, -(-n_tasks // n_worlds), seed, index)
            questions, once_us = _questions(world, seed)
            prepare_us.append(once_us)
            asked += _ask(questions, tasks)
        size = f"{n_robots} robots, {n_landmarks} landmarks"
        answers = pd.DataFrame(asked, columns=["name", "us", "landmarks"])
        reference_us = float(answers.us[answers.name == "breadth-first"].median())
        for name, own in answers.groupby("name", sort=False):
            reference = np.nan if name == "breadth-first" else reference_us
            bar = bar_us if str(name).startswith("best chance") else np.nan
            row = stopwatch.timed(f"{name}, {size}", own.us.to_numpy(), reference, bar)
            rows.append({**row, "landmarks": float(own.landmarks.mean())})
        rows.append(stopwatch.timed(f"prepared, {size}", prepare_us))
    return pd.DataFrame(rows, columns=COLUMNS)


def _questions(world: World, seed: int) -> tuple[dict[str, Question], float]:
    """Who is asked, each with all that may be prepared prepared; and microseconds for ours."""
    legs = world.legs()
    draws = generator(seed, "bench", "scores")
    scores = draws.uniform(0.5, 1.0, len(legs[0]))
    goal_scores = draws.uniform(0.5, 1.0, len(world.sees)).tolist()
    start_ns = perf_counter_ns()
    planner = Planner(len(world.sees), *legs, scores)
    prepare_us = (perf_counter_ns() - start_ns) / 1e3
    equal = Planner(len(world.sees), *legs, np.full(len(legs[0]), _SCORE))

    def goal(task: Task) -> dict[int, float]:
        return {robot: goal_scores[robot] for robot in world.seen_by[task.target]}

    def shortened(task: Task) -> Path:
        return shorten(world, ledger_chain(world, task, draws, robust=False), draws)

    failed: dict[Task, tuple[int, ...]] = {}

    def best(task: Task) -> Chain | None:
        chain = planner.best(task.start, goal(task))
        failed[task] = chain.landmarks if chain is not None else ()
        return chain

    questions: dict[str, Question] = {
        "best chance": best,
        "best chance, equal scores": lambda task: equal.best(
            task.start, dict.fromkeys(world.seen_by[task.target], _SCORE)
        ),
        "again without its landmarks": lambda task: planner.best(
            task.start, goal(task), without_landmarks=failed[task]
        ),
        f"{_ROUTES} disjoint routes": lambda task: next(
            iter(planner.routes(task.start, goal(task), _ROUTES)), None
        ),
        "breadth-first": lambda task: breadth_first(world, task.start, task.target),
        "shortened chain": shortened,
    }
    _ = world.landmarks_of, world.seen_by  # looked up once, before the clock runs
    return questions, prepare_us


def _ask(
    questions: Mapping[str, Question], tasks: Sequence[Task]
) -> Iterator[tuple[str, float, int | None]]:
    """Name, microseconds and number of landmarks of each answer: every task is asked all."""
    for question in questions.values():  # each once before it counts
        question(tasks[0])
    for task in tasks:
        for name, question in questions.items():
            start_ns = perf_counter_ns()
            answer = question(task)
            taken_us = (perf_counter_ns() - start_ns) / 1e3
            yield name, taken_us, None if answer is None else len(answer.robots)
