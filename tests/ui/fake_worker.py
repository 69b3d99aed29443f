"""Speaks the worker's protocol without an engine: `fake_worker.py BEHAVIOUR [arguments ignored]`, standard library only.

Behaviours: done, warned (a video is missing, exit 3), error, flags (an error that names options, exit 2), crash (Python exception), die
(kills itself), mute (exit 1, says nothing), hang (works, and then waits until it is asked to stop), stubborn (no request and no SIGTERM
stops it), chatty (lines that are no messages), offspring (leaves a child that holds the pipes).
SEEING_WIND_FAKE_SECONDS sets how long `done` and `hang` work.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

SECONDS = float(os.environ.get("SEEING_WIND_FAKE_SECONDS", "0.3"))
STAGES = ("observe", "build", "recover", "report")
stopped = False


def send(**message: object) -> None:
    """One message."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def listen() -> None:
    """Wait for the request to stop."""
    global stopped
    sys.stdin.readline()
    stopped = True


def cancelled() -> None:
    """End as the engine does at a safe point."""
    send(type="result", outcome="cancelled", seconds=1.0)
    sys.exit(130)


def work(seconds: float) -> None:
    """Progress through all stages, stopping at a safe point when asked."""
    rounds = 8
    for stage in STAGES:
        for k in range(rounds + 1):
            if stopped:
                cancelled()
            far = {"residual": 1.0 / (k + 1), "residual_unit": "px"}
            send(type="progress", stage=stage, fraction=k / rounds, message=f"{stage} part {k} of {rounds}", **far)
            rest = time.monotonic() + seconds / (len(STAGES) * (rounds + 1))
            while not stopped and (left := rest - time.monotonic()) > 0.0:
                time.sleep(min(0.02, left))  # a whole 0.02 s at each of 36 steps would make a short job a long one


def main() -> int:
    """Act as the first argument says."""
    behaviour = sys.argv[1]
    if os.environ.get("SEEING_WIND_CANCEL_BY_STDIN") == "1":
        threading.Thread(target=listen, daemon=True).start()
    print("log line of the worker", file=sys.stderr, flush=True)
    if behaviour == "done":
        work(SECONDS)
        send(type="warning", message="Stiffness capped at 1e5 Pa instead of 2e9 Pa.")
        send(type="result", outcome="converged", residual=0.21, iterations=7, seconds=SECONDS)
    elif behaviour == "warned":
        send(type="warning", message="overlay.mp4: This OpenCV has no codec.")
        send(type="result", outcome="converged", warnings=["overlay.mp4: This OpenCV has no codec."], seconds=SECONDS)
        return 3
    elif behaviour == "error":
        send(type="progress", stage="observe", fraction=0.1, message="reading")
        send(
            type="error",
            message="The box lies outside the frame of 480 x 270 pixels.",
            hint="Draw it round the object in the first frame.",
            mend="",
        )
        send(type="result", outcome="failed", message="The box lies outside the frame.")
        return 1
    elif behaviour == "flags":
        send(type="warning", message="--fov is a guess.")
        send(type="error", message="There is nothing in --box.", hint="Draw --box round the object.", mend="")
        send(type="result", outcome="failed", message="There is nothing in --box.")
        return 2
    elif behaviour == "crash":
        raise RuntimeError("the grid is empty")
    elif behaviour == "die":
        send(type="progress", stage="recover", fraction=0.4, message="iteration 3")
        os.kill(os.getpid(), signal.SIGKILL)
    elif behaviour == "mute":
        return 1
    elif behaviour == "hang":
        work(SECONDS)
        while not stopped:  # a caller that is slow to ask must find it running
            time.sleep(0.02)
        cancelled()
    elif behaviour == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        send(type="progress", stage="recover", fraction=0.5, message="not listening")
        time.sleep(60.0)
    elif behaviour == "chatty":
        print("Collecting numpy", flush=True)
        print("[1, 2]", flush=True)
        print('{"kind": "no type"}', flush=True)
        send(type="result", outcome="converged")
    elif behaviour == "offspring":
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
        send(type="result", outcome="converged", child=child.pid)
    return 0


if __name__ == "__main__":
    sys.exit(main())
