"""Run the tests that rest on recognition as other processors would: tools/processors.py [NAME ...].

Processors are those of ``vrchain bench processors``. Their libraries add and round in other
orders, so that what stands on a knife's edge falls to the other side. After -- tests may be named,
in place of them all, or a command: vrchain and its arguments. WORKERS: as for make.
"""

import os
import subprocess
import sys
from pathlib import Path

from vrchain.experiments.processors import PROCESSORS

ROOT = Path(__file__).resolve().parents[1]
RECOGNITION = [
    "tests/landmarks",
    "tests/navigation",
    "tests/homing",
    "tests/simulation",
    "tests/experiments/test_homing_experiment.py",
    "tests/experiments/landmarks",
    "tests/experiments/missions",
]


def main(arguments: list[str]) -> None:
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    names, tests = arguments[:cut] or list(PROCESSORS), arguments[cut + 1 :] or RECOGNITION
    if unknown := [name for name in names if name not in PROCESSORS]:
        sys.exit(f"expected processors of {', '.join(PROCESSORS)}, got {', '.join(unknown)}")
    workers = ["-n", os.environ.get("WORKERS", "2"), "--dist", "worksteal"]
    pytest = ["pytest", "-m", "not slow", *workers]
    command = [sys.executable, "-m", *([] if tests[0] == "vrchain" else pytest), *tests]
    failed = []
    for name in names:
        print(f"==> as processor {name}", flush=True)
        environment = {**os.environ, **PROCESSORS[name]}
        if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode != 0:
            failed.append(name)
    if failed:
        sys.exit(f"it failed as processor {', '.join(failed)}; see above")


if __name__ == "__main__":
    main(sys.argv[1:])
