"""
Make the maglev's small recording in ``bags/maglev_line``: a bag, its balises, where it is from.

Use: ``.venv/bin/python tools/ship_maglev_bag.py``. The same commit makes the same messages.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parent.parent / 'bags' / 'maglev_line'
MOST_BYTES = 2_000_000
SIMULATE = (
    *('simulate', 'maglev', '--scenario', 'line', '--seed', '5'),
    *('--set', 'line.length_m=4000', '--set', 'line.stops_m=0 2200 4000'),
)
README = """# maglev_line

A simulated maglev run over 4 km with a stop on the way: `loop/pose` (50 Hz), `radar/twist` (20 Hz),
`balise/pose` and the truth on `ground_truth/odometry`, in order of arrival, with all the errors of
the scenario `line`. `balises.csv` is the surveyed table; `run_info.yaml` has every setting and
what went wrong when. Nothing in it was recorded on a real train.

`tools/ship_maglev_bag.py` makes it anew: it runs

    {command} --output DIR

and puts the bag and its files here. This folder is the bag:

    evaluate maglev bags/maglev_line --output out
    maglev_federated_pf --ros-args -p balises:=bags/maglev_line/balises.csv
    sensor_publisher --ros-args -p source:=bags/maglev_line
"""


def main() -> None:
    """Simulate, check the size, and put everything in its place."""
    with tempfile.TemporaryDirectory() as temporary:
        made = Path(temporary)
        command = [str(Path(sys.executable).parent / SIMULATE[0]), *SIMULATE[1:]]
        subprocess.run([*command, '--output', str(made)], check=True)
        folder = made / 'bag'
        for name in ('balises.csv', 'run_info.yaml'):
            shutil.move(made / name, folder / name)
        text = README.format(command=shlex.join(SIMULATE))
        (folder / 'README.md').write_text(text, encoding='utf-8')
        size = sum(path.stat().st_size for path in folder.iterdir())
        if size > MOST_BYTES:
            sys.exit(f'{size} bytes: more than the {MOST_BYTES} that a shipped bag may have')
        shutil.rmtree(FOLDER, ignore_errors=True)
        FOLDER.parent.mkdir(exist_ok=True)
        shutil.copytree(folder, FOLDER)
    print(f'{FOLDER}: {size} bytes')


if __name__ == '__main__':
    main()
