"""Recordings as streams of serialised messages: bags byte for byte, phone exports as Imu."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io import bags, codec
from track_localization.io.checks import Finding, inspect_imu, to_si
from track_localization.io.recording import read_recording

IMU_TYPE = codec.IMU
TRUTH = 'ground_truth/'


class Item(NamedTuple):
    """One recorded message: topic, type, time of logging [ns], and its bytes as CDR."""

    topic: str
    msgtype: str
    log_ns: int
    cdr: bytes


def sensor_topics(source: str, wanted: str = '', ground_truth: bool = False) -> dict[str, str]:
    """
    Return {topic: type} of a bag's topics to send.

    ``wanted`` are topics separated by commas; empty means all, ``ground_truth/...`` only if asked
    for. Raise DataError for a topic that the bag does not have, and for a bag without any.
    """
    topics = bags.list_topics(source)
    names = [name.strip() for name in wanted.split(',') if name.strip()]
    if names:
        return {name: topic_type(source, topics, name) for name in names}
    sensors = {t: k for t, k in topics.items() if ground_truth or f'/{TRUTH}' not in f'/{t}'}
    if not sensors:
        raise DataError(f'{source}: no sensor topics; it has {", ".join(topics) or "none at all"}')
    return sensors


def topic_type(source: str, topics: dict[str, str], topic: str) -> str:
    """Return the message type of a bag's topic; raise DataError when it has no such topic."""
    name = bags.resolve_topic(source, topics, topic)
    if name is None:
        raise DataError(f'{source}: no topic {topic}; it has {", ".join(sorted(topics))}')
    return topics[name]


def imu_topic(source: str, topic: str) -> str:
    """
    Return the bag's topic to take for ``topic``: that one, or else the only Imu topic there is.

    Raise DataError when there is no Imu topic, or several and none by that name.
    """
    topics = bags.list_topics(source)
    name = bags.resolve_topic(source, topics, topic)
    if name is not None and topics[name] == codec.IMU:
        return name
    imus = [t for t, kind in topics.items() if kind == codec.IMU]
    if len(imus) == 1:
        return imus[0]
    having = f'Imu topics: {", ".join(imus)}; name one' if imus else 'it has no Imu topic at all'
    raise DataError(f'{source}: no Imu topic {topic}; {having}')


def bag_items(source: str, topics: dict[str, str]) -> Iterator[Item]:
    """
    Yield a bag's messages of ``topics`` {name in the bag: name to send on}, bytes untouched.

    Damaged parts are left out, and logged.
    """
    for topic, msgtype, log_ns, data in bags.raw_messages(source, list(topics), rejected={}):
        yield Item(topics[topic], msgtype, log_ns, data)


def series_items(series: ImuSeries, topic: str, frame_id: str) -> Iterator[Item]:
    """Yield the samples of a series as serialised Imu messages, logged at their own stamps."""
    for i in range(len(series)):
        message = codec.imu_message(series, i, frame_id)
        data = codec.TYPESTORE.serialize_cdr(message, codec.IMU)
        yield Item(topic, codec.IMU, codec.header_ns(message), bytes(data))


class ImuRecording(NamedTuple):
    """An IMU recording: ``items()`` yields it from the start; ``findings`` are for the user."""

    items: Callable[[], Iterator[Item]]
    findings: list[Finding]


def open_imu_recording(
    source: str, send_on: str, topic: str, frame_id: str, platform: str, units: str
) -> ImuRecording:
    """
    Open a bag's Imu topic, or a Sensor Logger export, to be sent on the topic ``send_on``.

    A bag's messages go out as they are, bad ones too, unless they are in other units or carry no
    stamp: then, and from a phone, new ones are made in SI units with ``frame_id``. ``platform``
    and ``units`` as in ``read_recording``. Raise DataError when the recording cannot be used; what
    is wrong but bearable is in the findings.
    """
    if not (Path(source).exists() and bags.is_bag(source)):
        recording = read_recording(source, topic, platform, units)
        imu, findings = recording.imu, recording.findings
        return ImuRecording(lambda: series_items(imu, send_on, frame_id), findings)
    name = imu_topic(source, topic)
    raw, rejected = bags.read_imu(source, name)
    series, notes = to_si(raw, units)
    findings = inspect_imu(series, rejected) + notes
    if notes or 'no_header_stamp' in rejected:
        return ImuRecording(lambda: series_items(series, send_on, frame_id), findings)
    return ImuRecording(lambda: bag_items(source, {name: send_on}), findings)
