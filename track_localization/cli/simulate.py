"""``simulate SYSTEM``: see ABOUT."""

from __future__ import annotations

from collections.abc import Sequence

from track_localization.cli import dispatch

ABOUT = 'A recorded run with sensors and truth, from a seed and a scenario.'


def main(argv: Sequence[str] | None = None) -> int:
    """Run it for the system that ``argv`` names first; return the exit code."""
    return dispatch.run('simulate', ABOUT, argv)


if __name__ == '__main__':
    raise SystemExit(main())
