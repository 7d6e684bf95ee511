"""Fail when a group of tests that should have run did not run at all."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree


def main(report: str, *groups: str) -> None:
    """Count the tests of each group in a JUnit report that were not skipped."""
    cases = list(ElementTree.parse(report).iter("testcase"))  # noqa: S314
    for group in groups:
        ran = [
            case
            for case in cases
            if case.get("classname", "").startswith(group) and case.find("skipped") is None
        ]
        if not ran:
            sys.exit(f"no test of {group} ran")
        sys.stdout.write(f"{len(ran)} tests of {group} ran\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
