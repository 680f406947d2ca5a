"""Packaging for ament_python, colcon and pip."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'track_localization'


def files(folder: str) -> list[tuple[str, list[str]]]:
    """Return the data_files entries that install ``folder`` under the package's share."""
    entries: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob('*')):
        if path.is_file():
            entries.setdefault(f'share/{PACKAGE}/{path.parent}', []).append(str(path))
    return list(entries.items())


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(include=['track_localization*', '*_localization', '*_localization.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *files('config'),
        *files('bags'),
    ],
    install_requires=[
        'numpy>=2.0',
        'scipy>=1.13',
        'numba>=0.60',
        'PyYAML>=6',
        'matplotlib>=3.8',
        'rosbags>=0.11',
        'pymap3d>=3.1',
    ],
    python_requires='>=3.11',
    zip_safe=False,
    maintainer='track_localization maintainers',
    description='Finds where a vehicle is along its track, live and from recordings.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'imu_publisher = coaster_localization.nodes.imu_publisher:main',
            'sensor_publisher = track_localization.ros.replay:main',
            'bag_recorder = track_localization.ros.record:main',
            'srdtw_matcher = coaster_localization.nodes.srdtw_matcher:main',
            'coaster_eskf = coaster_localization.nodes.eskf:main',
            'coaster_track_filter = coaster_localization.nodes.track_filter:main',
            'maglev_federated_pf = maglev_localization.nodes.federated_pf:main',
            'train_kf = train_localization.nodes.train_kf:main',
            'simulate = track_localization.cli.simulate:main',
            'evaluate = track_localization.cli.evaluate:main',
            'locate = track_localization.cli.locate:main',
            'compare = track_localization.cli.compare:main',
            'learn_line = track_localization.cli.learn_line:main',
            'reproduce = track_localization.cli.reproduce:main',
        ],
    },
)
