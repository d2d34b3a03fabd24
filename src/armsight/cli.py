"""The command line: parses, calls, prints. Everything else lives in ``armsight.commands``.

Exit codes: 0 well, 1 an error, 2 not understood, 130 interrupted.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Union

import tyro

from armsight import __version__
from armsight.commands.board import BoardCommand
from armsight.commands.calibrate import Calibrate
from armsight.commands.calibration import CalibrationCommand
from armsight.commands.charge import Charge
from armsight.commands.check import Check
from armsight.commands.dataset import Dataset
from armsight.commands.demo import Demo
from armsight.commands.detect_port import DetectPort
from armsight.commands.doctor import Doctor
from armsight.commands.experiment import ExperimentCommand
from armsight.commands.extend import Extend
from armsight.commands.new import New
from armsight.commands.patrol import Patrol
from armsight.commands.place import Place
from armsight.commands.recognise import Recognise
from armsight.commands.record import Record
from armsight.commands.replay import Replay
from armsight.commands.robots import Robots
from armsight.commands.run import RunCommand, run_with
from armsight.commands.servo import Servo
from armsight.commands.terminal import FULL, interruptible, make_lasting
from armsight.commands.train import Train
from armsight.commands.transfer import Transfer
from armsight.commands.view import ViewCommand
from armsight.kernel_cache import find_place

COMMANDS = (
    Demo,
    Doctor,
    Check,
    New,
    Patrol,
    RunCommand,
    Servo,
    Charge,
    Calibrate,
    CalibrationCommand,
    BoardCommand,
    Record,
    Replay,
    Robots,
    ViewCommand,
    Dataset,
    Recognise,
    Place,
    DetectPort,
    Train,
    Transfer,
    Extend,
    ExperimentCommand,
)

DESCRIPTION = """armsight: a robot arm that knows its surroundings.

  armsight demo                                  a guarded patrol, live in the browser
  armsight doctor                                what of this machine is missing or slow
  armsight new my_cell.toml                      start a cell of your own, then check it:
  armsight check my_cell.toml
  armsight patrol my_cell.toml --seconds 120 --headless --json result.json
  armsight run my_cell.toml --task my_module:MyTask   a task of your own, guarded
  armsight servo ur10_servoing --task ball       the arm comes after a ball that you drag
  armsight charge ur10_charging                  a parked car is found, plugged in and charged
  armsight calibrate ur5_calibration             find cameras and lenses by the board on the arm
  armsight recognise photo.jpg                   type, mask, base and joints of a robot in it
  armsight place photo.jpg --robot ur5 --joints-deg 0 -90 90 -90 -90 0   where its camera stood
  armsight detect-port photo.jpg                 type and pose of a charging port in it
  armsight experiment patrol-smoke               a table beside the papers' figures

armsight COMMAND --help explains a command; --version tells the version; --debug shows the trace of
an error. armsight is no certified safety function: never rely on it alone beside a person."""


def _commands(words: Sequence[str]) -> Any:
    """All commands for the parser; ``run`` with the options of the task that the words name."""
    wanted = [run_with(words[1:]) if c is RunCommand and words[0] == "run" else c for c in COMMANDS]
    # Built from the tuple, so that a command is named once.
    return Union[  # noqa: UP007
        tuple(Annotated[c, tyro.conf.subcommand(name_of(c))] for c in wanted)
    ]


def name_of(command: type) -> str:
    """What a command is called on the command line: ``DetectPort`` is ``detect-port``."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", command.__name__.removesuffix("Command")).lower()


INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Args:
        arguments: of the command line; None for those of this process, which then is armsight's
            own, and is ended whatever hangs in it.

    Raises:
        SystemExit: always, with the exit code.
    """
    # Ours are many small matrices. OpenBLAS's threads, which wait for each other in a busy loop,
    # make a calibration take three times the processor time, and the arm's loop wants the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    find_place(os.environ, Path(__file__).parent)
    make_lasting()
    try:
        code = run(sys.argv[1:] if arguments is None else arguments)
    except SystemExit as ended:  # help, or what the parser does not understand
        code = ended.code if isinstance(ended.code, int) else 1
    code = _told(code)
    line = sys.modules.get("armsight.devices.line")
    if arguments is None and line is not None and line.left_behind():
        # A thread hangs in a driver: to end in order takes seconds, and what it holds may hang too.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code; errors go to stderr in one line each."""
    words = list(arguments)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    if not words:
        words = ["--help"]
    _speak()
    from armsight.errors import ArmsightError

    try:
        if words == ["--version"]:
            print(f"armsight {__version__}")
            return 0
        with interruptible():
            command = tyro.cli(
                _commands(words),
                prog="armsight",
                description=DESCRIPTION,
                args=words,
                config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
            )
            return int(command.run())
    except ArmsightError as error:
        if debug:
            raise
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        if debug:
            raise
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        _hush()
        return 0
    except OSError as error:
        if debug or error.errno not in FULL:
            raise
        return _full(error)


def _told(code: int) -> int:
    """Hand on what was printed; an exit code that knows of a disk that takes no more."""
    if sys.stdout is None:
        return code
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _hush()
    except OSError as error:
        return _full(error)
    return code


def _hush() -> None:
    """The reader has gone (`armsight robots | head`): keep Python from complaining at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _full(error: OSError) -> int:
    """Say that there is no room."""
    _hush()
    what = error.filename or "what it says"
    print(f"{what}: cannot be written: {error.strerror}; free some space", file=sys.stderr)
    return 1


def _speak() -> None:
    """What takes long in the library tells of itself through logging; here it is to be seen."""
    import logging

    class ToStderr(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            print(record.getMessage(), file=sys.stderr)

    log = logging.getLogger("armsight")
    if not log.handlers:
        log.addHandler(ToStderr())
        log.setLevel(logging.INFO)
