"""Start a node, run it, end it: cleanly on Ctrl-C, SIGTERM, bad parameters and end of work."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions, install_signal_handlers
from rclpy.utilities import remove_ros_args

from track_localization.errors import DataError
from track_localization.ros.executor import StreamExecutor
from track_localization.settings import begins, walk

Work = Callable[[Node, SingleThreadedExecutor], None]


def run_node(
    make_node: Callable[[], Node],
    args: list[str] | None = None,
    help_text: str | None = None,
    settings: object | None = None,
    only: tuple[str, ...] = ('',),
    work: Work | None = None,
) -> int:
    """
    Make a node and spin it until it is told to end; return the exit code of the process.

    ``work(node, executor)`` replaces spinning and ends the process when it returns. 0: ended by a
    signal or done; 1: a parameter or a file cannot be used (one line on stderr); 2: the command
    line is wrong. ``--help`` prints ``help_text`` and those parameters of the config ``settings``
    whose names begin with ``only``.
    """
    args = sys.argv if args is None else args
    try:
        own = remove_ros_args(args)[1:]
    except Exception as error:
        return _wrong_usage(error)
    if own:
        asked = own[0] in ('-h', '--help')
        stream = sys.stdout if asked else sys.stderr
        if not asked:
            print(f'{own[0]!r} is not understood', file=stream)
        _show(usage(help_text or '', settings, only), stream)
        return 0 if asked else 2
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        return _wrong_usage(error)
    return _run(make_node, work or _spin, Path(args[0]).name if args else '')


def _show(text: str, stream: TextIO) -> None:
    """Print a text that a pager may not read to its end."""
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _wrong_usage(error: Exception) -> int:
    """Report malformed ROS arguments in one line (rclpy's types for them are private)."""
    print(f'wrong usage: {str(error).split(" Error: ")[0]}', file=sys.stderr)
    return 2


def _spin(node: Node, executor: SingleThreadedExecutor) -> None:
    executor.spin()


def _run(make_node: Callable[[], Node], work: Work, program: str) -> int:
    """
    Make, run and end a node; return the exit code.

    rclpy's signal handlers shut DDS down at once, wherever the program is. So while the node is
    being made a signal is only noted, and no half-made node is left; a second one interrupts.
    """
    node, executor = None, StreamExecutor()
    noted: list[int] = []

    def note(number: int, frame: object) -> None:
        if noted:
            raise KeyboardInterrupt
        noted.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, note)
    try:
        node = make_node()
        # What stays for good is not looked through again: such a search stops a node for 50 ms.
        gc.collect()
        gc.freeze()
        install_signal_handlers(SignalHandlerOptions.ALL)
        executor.add_node(node)
        if not noted:
            work(node, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except DataError as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except Exception:
        if rclpy.ok():
            raise
    finally:
        executor.shutdown(timeout_sec=0)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def usage(help_text: str, settings: object | None, only: tuple[str, ...] = ('',)) -> str:
    """Return the text of ``--help``: what the node does and each parameter with its default."""
    lines = [help_text.strip(), '', 'Parameters (--ros-args -p NAME:=VALUE):']
    for name, field, value in () if settings is None else walk(settings):
        if not begins(name, only):
            continue
        unit = f' [{field.metadata["unit"]}]' if field.metadata.get('unit') else ''
        choices = field.metadata.get('choices')
        one_of = f'; one of {", ".join(choices)}' if choices else ''
        lines.append(f'  {name} = {value!r}{unit}: {field.metadata.get("doc", "")}{one_of}')
    return '\n'.join(lines)
