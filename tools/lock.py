"""
Print the lock file for the environment this runs in: every distribution that pip installed.

The ROS wheels also unpack distributions that no index has (rclpy, sensor_msgs ...); those carry no
pip record and are left out. Use: ``.venv/bin/python tools/lock.py > requirements.lock``.
"""

from importlib.metadata import distributions

SKIP = {'pip', 'track-localization', 'track_localization'}

print('# Every version that this project is tested with; made by tools/lock.py.')
for name, version in sorted(
    (
        (d.metadata['Name'], d.version)
        for d in distributions()
        if (d.read_text('INSTALLER') or '').strip() == 'pip'
    ),
    key=lambda pair: pair[0].lower(),
):
    if name not in SKIP:
        print(f'{name}=={version}')
