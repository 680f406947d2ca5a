"""``evaluate SYSTEM``: see ABOUT."""

from __future__ import annotations

from collections.abc import Sequence

from track_localization.cli import dispatch

ABOUT = 'Every method over one recording: figures, trajectories, a report.'


def main(argv: Sequence[str] | None = None) -> int:
    """Run it for the system that ``argv`` names first; return the exit code."""
    return dispatch.run('evaluate', ABOUT, argv)


if __name__ == '__main__':
    raise SystemExit(main())
