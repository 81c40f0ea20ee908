"""What the judge counted goes with the report of a test, so that it comes back from other processes."""

from judge import COUNTS


def pytest_runtest_makereport(item, call):
    if call.when == "call" and not item.user_properties:
        item.user_properties.append(("counts", [(*key, count) for key, count in COUNTS.items()]))
        COUNTS.clear()
