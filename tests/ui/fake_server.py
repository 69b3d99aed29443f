"""The stand-in for the engine, warm: `fake_server.py SOCKET` forks a process for every job that fake_client.py hands it.

Most of a job of the stand-in is the import of NumPy, and the tests start hundreds. Ends when its standard input does.
"""

from __future__ import annotations

import importlib
import marshal
import os
import select
import signal
import socket
import sys
import traceback
from collections.abc import Callable

ROOMS = ("conventions", "masks", "record_arrays", "records", "take")
"""What the stand-in takes of the engine."""


def serve(address: str) -> None:
    """Until whoever started this is gone."""
    import fake_engine

    for room in ROOMS:
        importlib.import_module(f"seeing_wind.engine.{room}")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(address + ".new")
    listener.listen(16)
    os.rename(address + ".new", address)
    minders = 0
    while sys.stdin not in select.select([listener, sys.stdin], [], [])[0]:
        client = listener.accept()[0]
        minders += 1
        if not os.fork():
            listener.close()
            os._exit(mind(client, fake_engine.main))
        client.close()
        while minders and os.waitpid(-1, os.WNOHANG)[0]:
            minders -= 1


def mind(client: socket.socket, main: Callable[[], None]) -> int:
    """Run the client's job in a process of its own and tell its wait status; end it when the client has gone."""
    length, streams, _, _ = socket.recv_fds(client, 4, 3)
    options, folder, environment = marshal.loads(client.recv(int.from_bytes(length, "little"), socket.MSG_WAITALL))
    over, alive = os.pipe()
    pid = os.fork()
    if not pid:
        for target, stream in enumerate(streams):
            os.dup2(stream, target)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = ["fake_engine.py", *options]
        return run(main)
    for end in (alive, *streams):  # the job has its own copies, of which the first closes with it
        os.close(end)
    if over in select.select([client, over], [], [])[0]:
        client.send(str(os.waitpid(pid, 0)[1]).encode())
    else:
        os.kill(pid, signal.SIGKILL)
    return 0


def run(main: Callable[[], None]) -> int:
    """The exit code of a program."""
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    except Exception:
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


if __name__ == "__main__":
    serve(sys.argv[1])
