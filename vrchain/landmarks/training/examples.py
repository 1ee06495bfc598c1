"""Examples to learn from: panoramas of many suburbs, and by ground truth what each cell shows.

One file a suburb, written whole; a run that was broken off goes on with the next suburb.
"""

import io
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm.auto import tqdm

from vrchain.errors import LearnedError, SpecError
from vrchain.files import name_of, write_file
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.raster import cell_bearings_rad, cell_slopes, picture_of
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import Scene, build_scene
from vrchain.world.spec import SceneSpec, parse_spec
from vrchain.world.truth import VISIBLE_AREA_DEG2, VISIBLE_AZIMUTH_DEG

FORMAT = 2
_JPEG_QUALITY = 95
_TRIES = 1000
_TIMES = ("noon", "noon", "evening", "overcast")
_SEASONS = ("summer", "autumn", "winter", "spring")
_ARRAYS = ("cells", "range_m", "group", "poses", "centres_m", "kinds", "models")


@dataclass(frozen=True)
class ExampleConfig:
    """Which examples are made."""

    seed: int = 0  # of every random choice; below 1,000, as training seeds are
    suburbs: int = 90  # each with its own plan, light and season
    groups: int = 6  # places in each suburb around which panoramas are taken
    panoramas: int = 4  # at each place, headings independent
    reach_m: tuple[float, float] = (1.0, 40.0)  # of a group's others from its first, log-uniform
    robots: float = 0.3  # probability that a group's other robots stand in the picture


@dataclass(frozen=True, eq=False)
class Examples:
    """Panoramas of one suburb, in groups, with what their cells show.

    pictures: (n,) JPEG bytes, see ``raster.picture_of``; cells: (n, rows, columns) int16 object id
    a cell, -1 where there is no visible landmark; range_m: (n, rows, columns) float16, over the
    ground, to what a cell shows, 0 for sky; group: (n,) int; poses: (n, 3) x_m, y_m, yaw_rad;
    centres_m: (objects, 2) middles of the objects; kinds, models: (objects,) str.
    """

    pictures: tuple[bytes, ...]
    cells: NDArray[np.int16]
    range_m: NDArray[np.float16]
    group: NDArray[np.int16]
    poses: NDArray[np.float64]
    centres_m: NDArray[np.float64]
    kinds: NDArray[np.str_]
    models: NDArray[np.str_]

    def picture(self, index: int) -> NDArray[np.uint8]:
        """Picture ``index``, (rows, columns, 3) uint8 RGB."""
        coded = np.frombuffer(self.pictures[index], dtype=np.uint8)
        picture = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def make_examples(config: ExampleConfig, folder: Path) -> list[Path]:
    """The files of all suburbs, in order, under ``folder``; those already there are kept."""
    if not 0 <= config.seed < 1000:
        raise LearnedError(f"training seeds lie in 0..999, got {config.seed}")
    own = folder / config_digest(config)
    files = [own / f"suburb_{k:04d}.npz" for k in range(config.suburbs)]
    missing = [k for k, file in enumerate(files) if not file.exists()]
    for k in tqdm(missing, desc="suburbs to learn from", unit="", disable=None):
        _write(files[k], _look_around(varied_suburb(config.seed, k), config, k))
    return files


def config_digest(config: ExampleConfig) -> str:
    """A name for the examples of a configuration; ``suburbs`` only says how many there are."""
    known = {**asdict(config), "format": FORMAT}
    del known["suburbs"]
    return name_of(known)


def varied_suburb(seed: int, k: int) -> Scene:
    """Suburb ``k`` of a seed; drawn again where more is asked for than its plan holds."""
    for attempt in range(_TRIES):
        try:
            return build_scene(varied_spec(seed, k, attempt))
        except SpecError:
            continue
    raise LearnedError(f"suburb {k} of seed {seed} cannot be built")


def varied_spec(seed: int, k: int, attempt: int = 0) -> SceneSpec:
    """Suburb ``k`` of a seed: its own plan, density, share of twins, light and season."""
    draws = generator(seed, "example", k, attempt)
    often = {"fences": 40, "walls": 16, "hedges": 18}
    small = {"mailboxes": 26, "lamps": 24, "poles": 10, "signs": 12, "bins": 18, "hydrants": 6}

    def about(usual: int) -> int:
        return int(usual * draws.uniform(0.2, 1.1))

    return parse_spec(
        {
            "seed": int(draws.integers(2**31)),
            "twins": float(draws.choice([0.0, draws.uniform(0.0, 0.6)])),
            "houses": {"count": int(draws.integers(12, 33)), "two_storey": draws.uniform(0, 0.8)},
            "shops": {"count": int(draws.integers(0, 6))},
            "barns": {"count": int(draws.integers(0, 4))},
            "trees": {"count": about(90)},
            "vehicles": {"count": about(24)},
            "boundaries": {key: about(n) for key, n in often.items()},
            "furniture": {key: about(n) for key, n in {**small, "bushes": 30}.items()},
            "season": str(draws.choice(_SEASONS)),
            "light": {"time": str(draws.choice(_TIMES)), "sun_azimuth_deg": draws.uniform(0, 360)},
        }
    )


def read_examples(file: Path) -> Examples:
    """What ``make_examples`` wrote; LearnedError if the file is none of its own."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            coded, ends = stored["coded"].tobytes(), stored["ends"]
            starts = np.concatenate([[0], ends[:-1]])
            pictures = tuple(coded[a:b] for a, b in zip(starts, ends, strict=True))
            return Examples(pictures, *(stored[name] for name in _ARRAYS))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise LearnedError(
            f"{file} holds no examples ({error}): delete it and run again"
        ) from error


def _write(file: Path, examples: Examples) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        coded=np.frombuffer(b"".join(examples.pictures), dtype=np.uint8),
        ends=np.cumsum([len(p) for p in examples.pictures]),
        **{name: getattr(examples, name) for name in _ARRAYS},
    )
    write_file(file, buffer.getvalue())


def _look_around(scene: Scene, config: ExampleConfig, k: int) -> Examples:
    from vrchain.world.render import Renderer
    from vrchain.world.truth import GroundTruth

    draws = generator(config.seed, "example", k, "poses")
    renderer, truth, rig = Renderer(scene), GroundTruth(scene), CameraRig()
    grid = np.broadcast_arrays(cell_bearings_rad(rig)[None, :], cell_slopes()[:, None])
    landmark = np.array([o.landmark for o in scene.objects])
    pictures, cells, range_m, group, poses = [], [], [], [], []
    for number in range(config.groups):
        places = list(_group_of_poses(scene, config, draws))
        shown = draws.random() < config.robots
        for i, pose in enumerate(places):
            others = {f"R{j}": p for j, p in enumerate(places) if j != i and shown}
            picture = picture_of(renderer.render(pose, rig, others))
            ids, points_m = truth.look_along(pose, grid[0], grid[1], rig, others)
            bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
            coded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
            pictures.append(coded.tobytes())
            cells.append(_visible_landmarks(ids, landmark))
            range_m.append(np.nan_to_num(np.hypot(*(points_m[..., :2] - pose.xy_m).T).T))
            group.append(number)
            poses.append((pose.x_m, pose.y_m, pose.yaw_rad))
    return Examples(
        tuple(pictures),
        np.stack(cells),
        np.stack(range_m).astype(np.float16),
        np.array(group, dtype=np.int16),
        np.array(poses),
        np.array([o.bounds_m.mean(axis=0)[:2] for o in scene.objects]),
        np.array([o.kind for o in scene.objects]),
        np.array([o.model for o in scene.objects]),
    )


def _group_of_poses(
    scene: Scene, config: ExampleConfig, draws: np.random.Generator
) -> Iterator[Pose]:
    """A free place, and others around it."""
    half = np.array(scene.extent_m) / 2
    first: NDArray[np.float64] | None = None
    made = 0
    for _ in range(_TRIES):
        if first is None:
            place = draws.uniform(-half, half)
        else:
            away = np.exp(draws.uniform(*np.log(config.reach_m)))
            course = draws.uniform(0, 2 * np.pi)
            place = first + away * np.array([np.cos(course), np.sin(course)])
        if not scene.is_free([place]).all():
            continue
        first = place if first is None else first
        yield Pose(float(place[0]), float(place[1]), float(draws.uniform(-np.pi, np.pi)))
        made += 1
        if made == config.panoramas:
            return
    raise LearnedError(f"found only {made} free places near one another in {scene.name}")


def _visible_landmarks(ids: NDArray[np.int32], landmark: NDArray[np.bool_]) -> NDArray[np.int16]:
    """Ids of the cells that show a landmark large enough to count, elsewhere -1."""
    columns = ids.shape[1]
    cell_deg = 360.0 / columns
    own = np.where((ids >= 0) & landmark[np.maximum(ids, 0)], ids, -1)
    present = np.unique(own[own >= 0])
    area_deg2 = np.bincount(own[own >= 0], minlength=len(landmark)) * cell_deg**2
    width_deg = np.zeros(len(landmark))
    for i in present:
        width_deg[i] = (own == i).any(axis=0).sum() * cell_deg
    visible = (area_deg2 >= VISIBLE_AREA_DEG2) & (width_deg >= VISIBLE_AZIMUTH_DEG)
    return np.where((own >= 0) & visible[np.maximum(own, 0)], own, -1).astype(np.int16)
