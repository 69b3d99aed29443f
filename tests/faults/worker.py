"""The engine's worker under limits, and what a job of it left behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 3 * 2**30
"""Bytes beside what the imports take: no small input may need more."""
SECONDS = 90.0
"""Wall clock for one job, on a machine that has other things to do."""


@dataclass(frozen=True)
class Run:
    """How a job ended."""

    code: int
    """Exit code, or minus the signal."""
    messages: list[dict[str, Any]]
    """What it said on stdout."""
    stderr: str
    seconds: float
    work: float
    """Seconds of the processor, all threads together: what else the machine does is none of it."""

    @property
    def result(self) -> dict[str, Any]:
        """The last message, {} where the job was killed before it."""
        return self.messages[-1] if self.messages and self.messages[-1].get("type") == "result" else {}

    @property
    def error(self) -> dict[str, Any]:
        """The error message, {} without one."""
        return next((one for one in self.messages if one["type"] == "error"), {})

    @property
    def warnings(self) -> list[str]:
        return [one["message"] for one in self.messages if one["type"] == "warning"]

    @property
    def traceback(self) -> bool:
        return "Traceback (most recent call last)" in self.stderr or self.error.get("message", "").startswith("Unexpected ")


class Worker:
    """A warm engine: `with Worker() as worker: worker.run([...], folder)`."""

    def __enter__(self) -> Worker:
        more = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("zygote.py"))], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            cwd=ROOT, text=True,
            env={**os.environ, **more},
        )  # fmt: skip
        self._answer()
        return self

    def __exit__(self, *_: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(30.0)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the warm engine ended"
        return json.loads(line)

    def run(
        self, argv: list[Any], cwd: Path, *, seconds: float = SECONDS, memory: int = MEMORY, file_bytes: int | None = None,
        kill_after: float | None = None, marker: str = "", fail: int | None = None, vanish: Path | None = None, plain: bool = False,
    ) -> Run:  # fmt: skip
        """Run `seeing_wind.engine *argv` in the folder `cwd` under limits; see `zygote`."""
        assert self._process.stdin is not None
        with tempfile.TemporaryDirectory() as out:
            job = {
                "argv": [str(one) for one in argv], "cwd": str(cwd), "out": out, "seconds": seconds, "bytes": memory,
                "file_bytes": file_bytes, "kill_after": kill_after, "marker": marker, "fail": fail, "vanish": vanish and str(vanish),
                "plain": plain,
            }  # fmt: skip
            print(json.dumps(job), file=self._process.stdin, flush=True)
            answer = self._answer()
            texts = [_text(Path(out) / name) for name in ("stdout", "stderr")]
        lines = [line for line in texts[0].splitlines() if line.endswith("}")]  # a killed job leaves half a line
        return Run(answer["code"], [json.loads(line) for line in lines], texts[1], answer["seconds"], answer["work"])


def _text(path: Path) -> str:
    """What a job has written; nothing, of one that was killed before it had opened the file."""
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
