"""Where robots with other processors first differ: pixels, keypoints, network, record, claims, way.

Other processors are emulated: libraries are told to leave out what a poorer one has not.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.errors import VRChainError

# what each is told: torch, the C library, llvmpipe, numpy, oneDNN, OpenBLAS, OpenCV with its IPP,
# and VRChain's network
PROCESSORS: dict[str, dict[str, str]] = {
    "this": {},
    # Intel since Haswell (2013), AMD EPYC before Zen 4: no AVX-512, no bfloat16
    "AVX2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "LP_NATIVE_VECTOR_WIDTH": "256",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
        "OPENCV_IPP": "avx2",
        "VRCHAIN_BFLOAT16": "0",
    },
    # Intel Nehalem (2008), the least that numpy runs on: no AVX, no fused multiply-add either
    "SSE4": {
        "ATEN_CPU_CAPABILITY": "default",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
        "LP_NATIVE_VECTOR_WIDTH": "128",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENCV_CPU_DISABLE": "SSE4.1,SSE4.2,AVX,FP16,AVX2,AVX512-SKX",
        "OPENCV_IPP": "sse42",
        "VRCHAIN_BFLOAT16": "0",
    },
}
STAGES = ("pixels", "keypoints", "network", "record", "claims", "mission")
_COLUMNS = ["processor", "stage", "bytes", "same"]


def compare_processors(spec: Path, mission: Path, n_pairs: int, *, seed: int) -> pd.DataFrame:
    """One row a processor and stage: bytes, and the share of them that this processor gives too.

    spec: a scene of which pairs of panoramas are drawn; mission: one with a team of its own, whose
    first minute is driven: times, decisions and their reasons. Each runs in a process of its own.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        found: dict[str, dict[str, NDArray[np.uint8]]] = {}
        for name, told in PROCESSORS.items():
            file = Path(folder) / f"{len(found)}.npz"
            done = subprocess.run(
                [sys.executable, "-m", __name__, *map(str, (spec, mission, n_pairs, seed, file))],
                env={**os.environ, **told}, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode:
                reason = done.stderr.strip().splitlines()[-1:]
                raise VRChainError(f"processor {name!r}: {' '.join(reason) or 'was ended'}")
            found[name] = dict(np.load(file))
            for stage in STAGES:
                rows.append((name, stage, *_same(found[name][stage], found["this"][stage])))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _same(bytes_: NDArray[np.uint8], reference: NDArray[np.uint8]) -> tuple[int, float]:
    """How many there are, and the share of the longer that is the same, place by place."""
    n = min(len(bytes_), len(reference))
    alike = int((bytes_[:n] == reference[:n]).sum())
    return len(bytes_), alike / max(1, len(bytes_), len(reference))


def _compute(spec: Path, mission: Path, n_pairs: int, seed: int, file: Path) -> None:
    """Write what this processor makes of it, stage by stage."""
    from vrchain.experiments.landmarks.pairs import draw_pairs
    from vrchain.landmarks.extraction.raster import picture_of
    from vrchain.landmarks.extraction.record import encode_record, examine, read_parts
    from vrchain.landmarks.extraction.sift import extract
    from vrchain.landmarks.extraction.weights import load_network
    from vrchain.landmarks.matching.joint import compare_joint
    from vrchain.panorama import CameraRig
    from vrchain.world import load_scene
    from vrchain.world.render import Renderer

    scene, rig, network = load_scene(spec), CameraRig(), load_network()
    renderer = Renderer(scene)
    found: dict[str, list[bytes]] = {stage: [] for stage in STAGES}
    for poses in draw_pairs(scene, n_pairs, (1.0, 20.0), seed):
        records = []
        for pose in poses:
            panorama = renderer.render(pose, rig)
            features = extract(panorama)
            numbers = (features.bearing_rad, features.slope, features.size_rad)
            records.append(examine(panorama, features=features))
            found["pixels"].append(panorama.views.tobytes())
            found["keypoints"] += [x.tobytes() for x in (*numbers, features.descriptors)]
            found["network"] += [x.tobytes() for x in network(picture_of(panorama)).values()]
            *_, parts = read_parts(encode_record(records[-1]))
            found["record"] += [part.tobytes() for part in parts.values()]  # uncompressed
        for claim in compare_joint(records[0], records[1]).common:
            found["claims"].append(f"{claim.a.bearing_rad} {claim.b.bearing_rad}\n".encode())
    found["mission"] = _first_minute(mission, seed)
    stored: dict[str, Any] = {k: np.frombuffer(b"".join(v), np.uint8) for k, v in found.items()}
    np.savez(file, **stored)


def _first_minute(spec: Path, seed: int) -> list[bytes]:
    from vrchain.navigation.settings import MissionConfig
    from vrchain.simulation import mission
    from vrchain.world import load_scene

    with tempfile.TemporaryDirectory() as folder:
        run = mission.run_mission(
            load_scene(spec), Path(folder) / "ledger", seed=seed, config=MissionConfig(limit_s=60.0)
        )
    return [f"{d.time_s} {d.what} {d.why}\n".encode() for d in run.result.decisions]


if __name__ == "__main__":
    _, *paths, pairs, drawn_by, to = sys.argv
    _compute(Path(paths[0]), Path(paths[1]), int(pairs), int(drawn_by), Path(to))
