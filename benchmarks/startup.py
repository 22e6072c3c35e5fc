"""How long `wiclosure --help` takes (goal: under 0.5 s), and `import wiclosure` (goal: under 0.1 s).

Against Python alone, and against importing numpy, which `import wiclosure` does not.

python benchmarks/startup.py
"""

import subprocess
import sys
import time

REPEATS = 10

COMMANDS = {
    "python -c pass": [sys.executable, "-c", "pass"],
    "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
    "python -c 'import wiclosure'": [sys.executable, "-c", "import wiclosure"],
    "wiclosure --help": [sys.executable, "-m", "wiclosure", "--help"],
    "wiclosure --version": [sys.executable, "-m", "wiclosure", "--version"],
}


def seconds(command: list[str]) -> float:
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began


def main() -> None:
    best = {name: min(seconds(command) for _ in range(REPEATS)) for name, command in COMMANDS.items()}
    alone = best["python -c pass"]
    for name, value in best.items():
        print(f"{name:<30} {value * 1e3:6.0f} ms   {value / alone:5.1f} x python alone")


if __name__ == "__main__":
    main()
