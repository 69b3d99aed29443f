"""Asking a vision-language model behind any OpenAI-compatible endpoint (`POST URL/chat/completions`), also a local one.

Only the standard library is used. The key comes from the environment; it is never written anywhere, nor sent unencrypted to other machines.
"""

from __future__ import annotations

import base64
import http.client
import ipaddress
import json
import os
import threading
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from ...errors import ModelError, UsageError
from ...progress import Progress
from ...reading import parse_json

KEY_VARIABLE = "SEEING_WIND_MATERIAL_KEY"
"""Environment variable with the endpoint's key. Its name is not a common one, so that no other service's key is sent by accident."""

TIMEOUT = 120.0
"""Time within which an answer must arrive [s]: a local model on a CPU takes a minute for a frame."""

LARGEST_ANSWER = 1_000_000
"""Largest answer that is read [bytes]."""

LONGEST_SIDE = 1024
"""Length of a sent frame's longer side [px]: models scale larger frames down themselves."""

POLL = 0.2
"""Time between checks for cancellation [s]."""


@dataclass(frozen=True)
class Endpoint:
    """The address of a server, and the model to ask there."""

    url: str
    """Base address such as http://localhost:11434/v1."""
    model: str
    key: str = field(default="", repr=False)

    @property
    def name(self) -> str:
        """Model and host, for messages and sources; without user name, password or query."""
        return f"{self.model} at {urllib.parse.urlsplit(self.url).hostname}"


def endpoint_of(url: str, model: str) -> Endpoint:
    """The endpoint at `url`, with the key of `SEEING_WIND_MATERIAL_KEY` if that is set.

    Raises:
        UsageError: not an http(s) address, credentials or a query in it, or a key that would travel unencrypted to another machine.
    """
    try:
        parts = urllib.parse.urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError as error:
        raise UsageError(f"The endpoint {url!r} is no address ({error}).", "Give one such as http://localhost:11434/v1.") from error
    if parts.username or parts.password or parts.query:
        raise UsageError("The endpoint's address holds credentials or a query.", f"Put the key into the variable {KEY_VARIABLE}.")
    if parts.scheme not in ("http", "https") or not host:
        raise UsageError(f"The endpoint {url!r} is no http address.", "Give one such as http://localhost:11434/v1.")
    key = os.environ.get(KEY_VARIABLE, "").strip()
    if key and parts.scheme == "http" and not _is_here(host):
        raise UsageError(f"{KEY_VARIABLE} would be sent unencrypted to {host}.", "Use an https address, or unset the variable.")
    return Endpoint(url.rstrip("/"), model, key)


def _is_here(host: str) -> bool:
    """Whether `host` is this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def ask(endpoint: Endpoint, question: str, images: list[np.ndarray], progress: Progress) -> str:
    """The model's answer to `question` about `images` ((H, W, 3) uint8 RGB each), as text.

    Raises:
        ModelError: no connection, an error from the server, or an answer that is not a chat completion.
    """
    content: list[dict[str, Any]] = [{"type": "text", "text": question}]
    content += [{"type": "image_url", "image_url": {"url": data_url(image)}} for image in images]
    body = {"model": endpoint.model, "messages": [{"role": "user", "content": content}], "temperature": 0.0, "max_tokens": 800}
    return _text(endpoint, _waiting(lambda: _post(endpoint, body), progress))


def data_url(image: np.ndarray) -> str:
    """An image (H, W, 3) uint8 RGB as a JPEG in a data URL, reduced to `LONGEST_SIDE`."""
    scale = min(1.0, LONGEST_SIDE / max(image.shape[:2]))
    if scale < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    done, coded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 92])
    assert done
    return "data:image/jpeg;base64," + base64.b64encode(coded.tobytes()).decode("ascii")


def _waiting(call: Any, progress: Progress) -> bytes:
    """The result of `call()`, run in a thread of its own so that the user can cancel while a slow model computes."""
    outcome: list[Any] = []

    def work() -> None:
        try:
            outcome.append(call())
        except BaseException as error:  # raised again in the thread that waits
            outcome.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    while thread.is_alive():
        progress.check()
        thread.join(POLL)
    if isinstance(outcome[0], BaseException):
        raise outcome[0]
    return outcome[0]


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Refuses redirects, which would send frame and key to an address that the user has not named."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        return None


def _post(endpoint: Endpoint, body: dict[str, Any]) -> bytes:
    headers = {"Content-Type": "application/json", "User-Agent": "seeing-wind"}
    if endpoint.key:
        headers["Authorization"] = f"Bearer {endpoint.key}"
    request = urllib.request.Request(f"{endpoint.url}/chat/completions", json.dumps(body).encode("utf-8"), headers)
    check = "Check that the address and the model's name are right and that the server runs."
    handlers: list[Any] = [_NoRedirect]
    if _is_here(urllib.parse.urlsplit(endpoint.url).hostname or ""):
        handlers.append(urllib.request.ProxyHandler({}))  # a proxy cannot reach this machine's own servers
    try:
        with urllib.request.build_opener(*handlers).open(request, timeout=TIMEOUT) as answer:
            data = answer.read(LARGEST_ANSWER + 1)
    except urllib.error.HTTPError as error:
        said = error.read(300).decode("utf-8", errors="replace").strip()
        if endpoint.key:
            said = said.replace(endpoint.key, "(key)")
        hint = f"Check the key in {KEY_VARIABLE}." if error.code in (401, 403) else check
        raise ModelError(f"The endpoint {endpoint.name} refused with {error.code}: {said or error.reason}.", hint) from None
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        raise ModelError(f"The endpoint {endpoint.name} does not answer ({reason}).", check) from error
    if len(data) > LARGEST_ANSWER:
        raise ModelError(f"The answer of {endpoint.name} is longer than {LARGEST_ANSWER // 1000} kB.", check)
    return data


def _text(endpoint: Endpoint, data: bytes) -> str:
    """The text of the first choice in a chat completion."""
    try:
        text = parse_json(data)["choices"][0]["message"]["content"]
    except (ValueError, KeyError, IndexError, TypeError):
        text = None
    if not isinstance(text, str):
        raise ModelError(
            f"The answer of {endpoint.name} is no chat completion.",
            "Give the address of an OpenAI-compatible server, which usually ends in /v1.",
        )
    return text
