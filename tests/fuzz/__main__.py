"""Draw problems for some minutes and count the false claims: python tests/fuzz --minutes 10 --seed 1 [--workers 2]

Every round runs the laws of `test_fuzz.py` with another seed. Each false claim is shown with the smallest problem that
Hypothesis finds for it, as code that runs. The exit code is 1 if there is one.
"""

import argparse
import os
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

KINDS = ("examples", "solved", "false solved", "false bound", "false unique", "false infeasible", "false crossing")
KINDS += ("lost iterate", "late", "units")


class Counted:
    """Collects the counts and the failures of all processes."""

    def __init__(self):
        self.counts, self.failures = Counter(), []

    def pytest_runtest_logreport(self, report):
        if report.when == "call":
            for law, kind, count in dict(report.user_properties).get("counts", []):
                self.counts[law, kind] += count
            if report.failed:
                self.failures.append(report.longreprtext)


def main():
    parser = argparse.ArgumentParser(prog="python tests/fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0, help="no round begins after that (default 1)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed draws the same problems")
    parser.add_argument("--workers", default="0", help="processes (default: this one)")
    parser.add_argument("--examples", type=int, default=1000, help="of each law in a round (default 1000)")
    asked = parser.parse_args()
    os.environ["FUZZ_EXAMPLES"] = str(asked.examples)
    counted, end, rounds = Counted(), time.monotonic() + 60.0 * asked.minutes, 0
    here = str(Path(__file__).parent)
    while time.monotonic() < end and not counted.failures:
        options = [here, "-q", "--no-header", "-p", "no:cacheprovider", "-n", asked.workers, "-m", ""]
        code = pytest.main([*options, f"--hypothesis-seed={asked.seed + rounds}", "--timeout=1800"], plugins=[counted])
        rounds += 1
        if code not in (0, 1):
            return int(code)
    print(f"\n{rounds} rounds from seed {asked.seed}\n{'law':12}" + "".join(f"{kind:>17}" for kind in KINDS))
    for law in sorted({law for law, _ in counted.counts}):
        print(f"{law:12}" + "".join(f"{counted.counts[law, kind]:17}" for kind in KINDS))
    return int(bool(counted.failures))


sys.exit(main())
