"""Asks the warm stand-in (fake_server.py) for a job: `fake_client.py SOCKET PROGRAM [options]`. Standard library only, and little of it.

Its streams, its folder and its environment are handed over, and it ends as the job does. A job that is to do something else than work,
as signals and child processes are, is a process of its own, and so is every job where nobody listens.
"""

import _socket
import array
import marshal
import os
import sys


def asked(address: str, options: list[str]) -> int:
    """The job's wait status."""
    with_streams = [(_socket.SOL_SOCKET, _socket.SCM_RIGHTS, array.array("i", [0, 1, 2]))]
    server = _socket.socket(_socket.AF_UNIX, _socket.SOCK_STREAM)
    server.connect(address)
    job = marshal.dumps((options, os.getcwd(), dict(os.environ)))
    server.sendmsg([len(job).to_bytes(4, "little")], with_streams)
    server.sendall(job)
    return int(server.recv(16))


address, program, *options = sys.argv[1:]
if os.environ.get("SEEING_WIND_FAKE", "done") == "done" and os.path.exists(address):
    code = os.waitstatus_to_exitcode(asked(address, options))
    if code < 0:
        os.kill(os.getpid(), -code)
    sys.exit(code)
os.execv(sys.executable, [sys.executable, program, *options])
