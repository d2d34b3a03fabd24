"""Terminals of other people: none, gone, full, narrow, without our characters; signals."""

import ctypes
import errno
import io
import os
import pty
import signal
import subprocess
import sys
import threading
import time

import pytest

from armsight.commands.terminal import interruptible, make_lasting

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}


def call(*words, into=subprocess.PIPE, **environment):
    return subprocess.run(
        [sys.executable, "-m", "armsight", *words],
        stdout=into,
        stderr=subprocess.PIPE,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.mark.parametrize("words", [["robots"], ["--help"], ["check", "größe.toml"]])
def test_a_terminal_without_our_characters(words):
    ended = call(*words, **ASCII)
    assert ended.stdout.decode("ascii")
    assert b"Traceback" not in ended.stderr


def test_a_files_name_that_is_no_text(tmp_path):
    file = os.fsencode(tmp_path) + b"/\xff.toml"
    ended = call("check", file, PYTHONIOENCODING="utf-8:strict")
    assert ended.returncode == 1
    assert b"no such file" in ended.stdout
    assert b"Traceback" not in ended.stderr


@pytest.mark.parametrize("words", [["--version"], ["experiment"], ["robots", "--help"]])
def test_a_disk_that_takes_no_more_words(words):
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    with open("/dev/full", "wb") as full:
        ended = call(*words, into=full)
    assert ended.returncode == 1
    assert ended.stderr.decode().splitlines() == [
        "what it says: cannot be written: No space left on device; free some space"
    ]


def test_a_pipe_gets_whole_lines():
    """80 columns were guessed where nothing is known: figures and lines were cut."""
    experiments = call("experiment").stdout.decode().splitlines()
    assert all(line[:1] != " " and len(line.split()) > 2 for line in experiments)
    assert any(len(line) > 80 for line in experiments)
    assert "…" not in call("robots").stdout.decode()


def test_a_narrow_terminal_loses_no_figures():
    from rich.console import Console

    from armsight.robots.report import tools_table

    console = Console(width=60, file=io.StringIO())
    console.print(tools_table())
    assert "…" not in console.file.getvalue()


def test_a_terminal_that_goes_takes_nothing_along(monkeypatch):
    ours, theirs = pty.openpty()
    with monkeypatch.context() as patched:
        for name in ("stdout", "stderr"):
            patched.setattr(sys, name, open(os.dup(theirs), "w"))  # noqa: SIM115
        make_lasting()
        os.close(theirs)
        print("heard", flush=True)
        os.close(ours)
        with pytest.raises(OSError) as gone:
            os.write(sys.stdout.fileno(), b"x")
        assert gone.value.errno == errno.EIO
        for _ in range(3):
            print("not heard", flush=True)
            print("not heard", file=sys.stderr, flush=True)
        sys.stdout.close()
        sys.stderr.close()


def test_what_is_said_on_the_way_is_not_worth_the_run(monkeypatch):
    """`armsight patrol ... 2>&1 | head`: who looked on has gone, the run goes on."""
    reader, writer = os.pipe()
    os.close(reader)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", open(writer, "w"))  # noqa: SIM115
        patched.setattr(sys, "stdout", None)
        make_lasting()
        print("anybody?", file=sys.stderr, flush=True)
        sys.stderr.close()


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
def test_signals_interrupt_what_is_no_session(how):
    before = signal.getsignal(how)
    ended = []

    def work():
        with interruptible():
            try:
                os.kill(os.getpid(), how)
                time.sleep(10.0)
            finally:
                ended.append("cleaned up")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert ended
    assert signal.getsignal(how) is before


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_is_not_lost_in_a_callback_of_compiled_code(how, capfd):
    """Numba's compiler calls back right after each long wait: ctypes swallows what is raised."""
    before = sys.unraisablehook
    heeded = signal.signal(signal.SIGINT, signal.default_int_handler)  # not in a shell's background
    called, ended = [], []

    @ctypes.CFUNCTYPE(None)
    def call_back():
        called.append(True)
        os.kill(os.getpid(), how)
        time.sleep(0.01)

    def work():
        with interruptible():
            call_back()
            ended.append("the callback has returned, the first interrupt is lost")
            threading.Event().wait(10.0)
            ended.append("waited on")

    try:
        with pytest.raises(KeyboardInterrupt):
            work()
    finally:
        signal.signal(signal.SIGINT, heeded)
    assert called
    assert len(ended) == 1
    assert sys.unraisablehook is before
    assert "Traceback" not in capfd.readouterr().err


def test_other_lost_errors_are_said_as_before():
    said = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "unraisablehook", said.append)

        @ctypes.CFUNCTYPE(None)
        def call_back():
            raise ValueError("of a driver")

        with interruptible():
            call_back()
    assert [lost.exc_type for lost in said] == [ValueError]


def test_what_was_to_be_ignored_is():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.01)
    finally:
        signal.signal(signal.SIGHUP, before)
