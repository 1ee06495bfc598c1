"""Reported figures: made again and compared, and their history as a page.

``figures/results.csv`` holds every figure that README and docs/reproduction.md quote, a row for
each time it was measured: its value, 95 % interval, n, seed, commit, date, the command that prints
it, and where in that command's JSON it is (nothing: it is read by hand). Rows are only ever added.

    python tools/results.py                  # what can be made again, and by which command
    python tools/results.py missions         # the newest of these anew: did any move?
    python tools/results.py missions --write # and add what came
    python tools/results.py --history        # write docs/results/history.md and its two pictures

``all`` names all of them, which takes days: so nothing is run that is not named.
"""

import argparse
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from vrchain.plots.save import png_bytes
from vrchain.plots.style import BLUE, ORANGE, panels

ROOT = Path(__file__).resolve().parents[1]
RESULTS, HISTORY = ROOT / "figures/results.csv", ROOT / "docs/results/history.md"
CONDITIONS, AGES = ROOT / "docs/results/conditions.png", ROOT / "docs/results/ages.png"
_UNDER = "missions under "  # so begins a figure of missions under a condition
_USUAL = "eight missions as usual"
_AGES = (  # what a condition is called, where on its axis the usual missions are, and the axis
    (r"silent for (\d+) min", 0.0, "minutes for which the others are silent"),
    (r"rules (\d+) times rarer", 1.0, "times the thresholds of the update rules"),
)
_KEY = {
    "missions/success": "missions that arrive",
    "missions/spl_chain": "their spl_chain",
    "missions/seconds": "their mean time, s",
    "landmarks/1-10 m/cnn+sift/pair_success": "surest claim right, 1-10 m",
    "landmarks/10-20 m/cnn+sift/pair_success": "surest claim right, 10-20 m",
    "landmarks/20-40 m/cnn+sift/pair_success": "surest claim right, 20-40 m",
    "homing/return ratio": "homing: returned",
    "ledger/update, 500 positions": "ledger update, ms",
    "ledger/retrieval of a panorama, 500 positions": "retrieval of a panorama, ms",
}
_ALIKE = 0.05  # of a figure without an interval: it has moved if it is off by more of itself


def reported(path: Path = RESULTS) -> pd.DataFrame:
    """All rows, the oldest first; numbers as they were written."""
    return pd.read_csv(path, dtype=str, keep_default_na=False)


def newest(rows: pd.DataFrame) -> pd.DataFrame:
    """The last row of each figure."""
    return rows.drop_duplicates("figure", keep="last")


def printed_by(command: str) -> Any:
    """What a command prints as JSON; RuntimeError if it fails."""
    words = [str(Path(sys.executable).with_name("vrchain")), *shlex.split(command)[1:], "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["it printed nothing"])[-1])
    return json.loads(done.stdout)


def measured(printed: Any, where: str) -> tuple[float, list[float]]:
    """A figure and its interval, in what a command printed."""
    *within, name = where.split(".")
    for key in within:
        printed = printed[key]
    return float(printed[name]), list(printed.get(f"{name}_ci") or [])


def has_moved(row: pd.Series, value: float, interval: Sequence[float]) -> bool:
    """Whether a figure is off the reported one by more than both intervals tell."""
    old = float(row["value"])
    low, high = (float(row[end]) if row[end] else None for end in ("low", "high"))
    if low is None or high is None:
        return abs(value - old) > _ALIKE * abs(old)
    first, last = interval or (value, value)
    return last < low or first > high


def made_again(
    rows: pd.DataFrame, run: Callable[[str], Any] = printed_by, tell: Callable[[str], Any] = print
) -> pd.DataFrame:
    """Run the rows' commands, each once, and tell of each figure if it moved; the new rows."""
    now = datetime.now(UTC).date().isoformat()
    # code that is in no commit leaves a "+", which a test of the table refuses
    commit = _git("describe", "--always", "--exclude", "*", "--dirty=+")
    made = []
    for command, own in rows.groupby("command", sort=False):
        if not all(own["where"]):
            tell(f"by hand: {command}: {', '.join(own.figure)}")
            continue
        try:
            printed = run(str(command))
            found = [measured(printed, where) for where in own["where"]]
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            tell(f"failed: {command}: {error}")
            continue
        for (_, row), (value, interval) in zip(own.iterrows(), found, strict=True):
            verdict = "MOVED" if has_moved(row, value, interval) else "within"
            ends = [f"{end:.4g}" for end in interval] or ["", ""]
            tell(f"{verdict}: {row['figure']}: {value:.4g} {interval}, was {row['value']}")
            changed = {"value": f"{value:.4g}", "low": ends[0], "high": ends[1]}
            made.append({**row, **changed, "commit": commit, "date": now})
    return pd.DataFrame(made, columns=rows.columns)


def offered(rows: pd.DataFrame) -> list[str]:
    """A line for each command of some rows: what it makes again, if it is named."""
    return [
        f"{'if named' if all(own['where']) else 'by hand'}: {command}: {', '.join(own.figure)}"
        for command, own in rows.groupby("command", sort=False)
    ]


def history(rows: pd.DataFrame) -> str:
    """The page of key figures by commit."""
    lines = [
        "# Key figures by commit",
        "",
        "Written by `python tools/results.py --history` from",
        "[results.csv](../../figures/results.csv), which has seeds, commands and all other",
        "figures that are quoted. Brackets: 95 % intervals.",
        "",
        "| figure | date | commit | seed | value | n |",
        "|---|---|---|---|---|---|",
    ]
    for figure, name in _KEY.items():
        for _, row in rows[rows.figure == figure].iterrows():
            ends = f" [{row['low']}, {row['high']}]" if row["low"] else ""
            value = f"{row['value']}{ends}"
            told = (name, row["date"], row["commit"], row["seed"], value, row["n"])
            lines.append(f"| {' | '.join(told)} |")
    return "\n".join(lines) + "\n"


def _under(rows: pd.DataFrame) -> pd.DataFrame:
    """Figures of missions as they were measured last, with columns condition and what."""
    under = newest(rows[rows.figure.str.startswith(_UNDER)])
    told = under.figure.str.removeprefix(_UNDER).str.rsplit("/", n=1, expand=True)
    return under.assign(condition=told[0], what=told[1])


def _bars(own: pd.DataFrame) -> tuple[pd.Series, list[pd.Series]]:
    """The values of figures, and how far their intervals reach down and up."""
    value, low, high = (own[end].astype(float) for end in ("value", "low", "high"))
    return value, [value - low, high - value]


def ages(rows: pd.DataFrame) -> Figure:
    """Success and spl_chain against how long the others are silent, and how rarely they publish."""
    under = _under(rows)
    told = under.set_index(["condition", "what"])
    figure, axes = panels(10, 3.6, 1, 2, sharey=True)
    for panel, (pattern, usual, label) in zip(axes, _AGES, strict=True):
        found = {name: re.search(pattern, name) for name in under.condition.unique()}
        at = {_USUAL: usual} | {name: float(m[1]) for name, m in found.items() if m}
        for what, colour in (("success", BLUE), ("spl_chain", ORANGE)):
            value, bars = _bars(told.loc[[(name, what) for name in at]])
            panel.errorbar(
                [*at.values()], value, bars, fmt="o-", color=colour, capsize=3, label=what
            )
        published = told.value.loc[[(name, "published") for name in at]].astype(float)
        names = [f"{x:g}\n({n:.0f})" for x, n in zip(at.values(), published, strict=True)]
        panel.set_xticks([*at.values()], names)
        panel.set(xlabel=f"{label} (publications a mission)", ylim=(-0.02, 1.05))
        panel.grid(axis="y", alpha=0.4)
    axes[0].legend(loc="lower left")
    figure.suptitle("Missions by the age and the number of panoramas (eight each; bars: 95 %)")
    return figure


def conditions(rows: pd.DataFrame) -> Figure:
    """Success and spl_chain of missions under each condition, as it was measured last."""
    under = _under(rows)
    names = list(under.condition.unique()[::-1])
    figure, axes = panels(10, 0.36 * len(names) + 1.2, 1, 2, sharey=True)
    titles = {"success": "share that arrives", "spl_chain": "spl_chain: how direct, 1 is best"}
    for panel, (what, title) in zip(axes, titles.items(), strict=True):
        own = under[under.what == what].set_index("condition").reindex(names)
        value, bars = _bars(own)
        panel.errorbar(value, range(len(names)), xerr=bars, fmt="o", color=BLUE, capsize=3)
        panel.set(title=title, xlim=(-0.02, 1.02))
        panel.grid(axis="x", alpha=0.4)
    driven = under[under.what == "success"].set_index("condition").loc[names, "n"]
    axes[0].set_yticks(range(len(names)), [f"{name} ({n})" for name, n in driven.items()])
    figure.suptitle("Missions under each condition (how many were driven; bars: 95 %)")
    return figure


def _git(*words: str) -> str:
    return subprocess.check_output(["git", "-C", str(ROOT), *words], text=True).strip()


def main(words: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="Reported figures, made again.")
    parser.add_argument("names", nargs="*", help="figures whose names begin so; or all")
    parser.add_argument("--write", action="store_true", help="add what came to results.csv")
    parser.add_argument("--history", action="store_true", help="only write the page of key figures")
    given = parser.parse_args(words)
    rows = reported()
    if not given.history:
        last = newest(rows)
        if not given.names:
            print("\n".join(offered(last)))
            return
        chosen = last if "all" in given.names else last[last.figure.str.startswith((*given.names,))]
        if chosen.empty:
            known = ", ".join(sorted({name.split("/")[0] for name in last.figure}))
            parser.error(f"expected all, or what begins with {known}; got {' '.join(given.names)}")
        made = made_again(chosen)
        if not given.write:
            return
        with RESULTS.open("a") as file:  # the rows before are left as they were, to the byte
            made.to_csv(file, header=False, index=False, lineterminator="\n")
        rows = pd.concat([rows, made])
    HISTORY.write_text(history(rows))
    CONDITIONS.write_bytes(png_bytes(conditions(rows)))
    AGES.write_bytes(png_bytes(ages(rows)))


if __name__ == "__main__":
    main()
