"""The only module that uses Ray: a cluster whose nodes have exactly this engine, and jobs that run on it.

Ray is an optional package (`errors.extra("farm")`), in the engine's environment of every node.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from ...errors import MissingPackage, SeeingWindError, UsageError, extra
from .needs import Needs
from .node import Order, edition
from .process import Message

NODE = f"{__package__}.node"
KNOCK_SECONDS = 5.0
PROBE_SECONDS = 120.0
"""Seconds in which a node must start a Python and report its engine's edition."""


class Lost(Exception):
    """A job's worker or node died, or its results were lost with the node. The job can be tried again."""


@dataclass
class Running:
    """A job on the cluster; made by `Cluster.start`."""

    generator: Any


class Cluster:
    """A connection to a running Ray cluster. At the end of its `with` block it is closed; the cluster keeps running.

    Args:
        address: `auto` for the cluster that this machine belongs to, or HOST:PORT of a cluster's head.

    Raises:
        MissingPackage: Ray is not installed.
        UsageError: the address is one of Ray's client, which does not stream results.
        SeeingWindError: there is no cluster, or it has another version of Ray or Python.
    """

    def __init__(self, address: str) -> None:
        try:
            import ray
            from ray.util import scheduling_strategies
        except ImportError as error:
            raise MissingPackage("The engine's Python lacks Ray.", f"Install it: {extra('farm')}.") from error
        if address.startswith("ray://"):
            raise UsageError(
                f"{address} is an address for Ray's client.", "Join the cluster with `ray start --address=HOST:6379` and use --ray auto."
            )
        self._ray, self._strategies = ray, scheduling_strategies
        try:
            _knock(address)
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, configure_logging=False)
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            first = str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
            raise SeeingWindError(
                f"There is no Ray cluster at {address}: {first}.", "Start one with `ray start --head`, and join it from every machine."
            ) from error
        self._store: dict[tuple[str, int, int], Any] = {}
        self._task = ray.remote(_task())

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._ray.shutdown()

    def nodes(self) -> dict[str, str]:
        """The living nodes that can run jobs: id -> address."""
        return {
            node["NodeID"]: node["NodeManagerAddress"]
            for node in self._ray.nodes()
            if node["Alive"] and node["Resources"].get("CPU", 0.0) > 0.0
        }

    def check(self, beat: Callable[[], None]) -> None:
        """Check that every node has this engine.

        Args:
            beat: called again and again while waiting; an exception from it ends the check.

        Raises:
            SeeingWindError: a node has no engine or another one, or does not answer; or no node can run jobs.
        """
        nodes = self.nodes()
        if not nodes:
            raise SeeingWindError("No node of the cluster has a processor to lend.", "Start one with `ray start --address=HOST:PORT`.")
        probe = self._ray.remote(node_probe())
        asked = {node: probe.options(num_cpus=0, max_retries=0, scheduling_strategy=self._on(node, False)).remote() for node in nodes}
        waiting, waited = list(asked.values()), 0.0
        while waiting and waited < PROBE_SECONDS:
            _, waiting = self._ray.wait(waiting, num_returns=len(waiting), timeout=0.25)
            waited += 0.25
            beat()
        wanted = edition()
        for node, answer in asked.items():
            said = "does not answer" if answer in waiting else self._answer(answer)
            if said != wanted:
                has = said if said.startswith(("lacks", "does")) else f"has the engine {said}"
                raise SeeingWindError(
                    f"The node {nodes[node]} {has}; this machine has {wanted}.",
                    "Install the same version of seeing-wind with its extra `farm` in the Python that runs Ray there.",
                )

    def _answer(self, answer: Any) -> str:
        try:
            return str(self._ray.get(answer, timeout=0))
        except self._ray.exceptions.RayError as error:
            return f"does not answer ({type(error).__name__})"

    def _on(self, node: str, soft: bool) -> Any:
        return self._strategies.NodeAffinitySchedulingStrategy(node_id=node, soft=soft)

    def fitting(self, needs: Needs, jobs: int) -> Needs:
        """`needs`, limited to what one of `jobs` jobs can get: at most the largest node's cores and memory, and its share of all cores."""
        alive = [node["Resources"] for node in self._ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0.0) > 0.0]
        cpus = max((int(node["CPU"]) for node in alive), default=needs.cpus)
        cpus = min(cpus, int(sum(node["CPU"] for node in alive)) // max(jobs, 1))
        memory = max((int(node.get("memory", 0)) for node in alive), default=needs.memory)
        return Needs(max(min(needs.cpus, cpus), 1), min(needs.memory, memory))

    def put(self, path: Any) -> Any:
        """A reference to the content of a file in the object store, where a clip that many jobs share is kept once."""
        stat = path.stat()
        key = (str(path), stat.st_mtime_ns, stat.st_size)
        if key not in self._store:
            self._store[key] = self._ray.put(path.read_bytes())
        return self._store[key]

    def start(self, order: Order, files: dict[str, Any], needs: Needs, node: str | None) -> Running:
        """Start a job.

        Args:
            files: references from `put`, by path.
            needs: what is reserved for the job.
            node: the node on which to run it if that node lives; None leaves the choice to Ray.
        """
        options = {"num_cpus": needs.cpus, "memory": needs.memory, "max_retries": 0}
        if node is not None:
            options["scheduling_strategy"] = self._on(node, True)
        return Running(self._task.options(**options).remote(order, list(files), list(files.values()), edition()))

    def ready(self, running: list[Running], seconds: float) -> list[Running]:
        """The jobs among `running` that have a message or have ended; waits at most `seconds` for the first."""
        found, _ = self._ray.wait([each.generator for each in running], num_returns=1, timeout=seconds)
        return [each for each in running if any(each.generator is one for one in found)]

    def next(self, running: Running) -> Message | None:
        """The next message of a job that is ready; None at its end.

        Raises:
            Lost: its worker or node died.
            SeeingWindError: it was cancelled on the cluster, or raised an unexpected exception.
        """
        errors = self._ray.exceptions
        try:
            return self._ray.get(next(running.generator))
        except StopIteration:
            return None
        except errors.TaskCancelledError as error:
            raise SeeingWindError("The job was cancelled on the cluster.", "Run the batch again.") from error
        except errors.RayTaskError as error:
            raise SeeingWindError(f"Unexpected {str(error).strip().splitlines()[-1]}.", "This is a defect: please report it.") from error
        except errors.RayError as error:
            raise Lost(type(error).__name__) from error

    def cancel(self, running: Running, force: bool) -> None:
        """Stop a job: at once if `force`, otherwise at a safe point."""
        self._ray.cancel(running.generator, force=force)


def _knock(address: str) -> None:
    """Check that a process listens at HOST:PORT, as Ray itself would try for minutes. Raises OSError or ValueError if none does."""
    if address != "auto":
        host, _, port = address.rpartition(":")
        socket.create_connection((host.strip("[]"), int(port)), timeout=KNOCK_SECONDS).close()


# The inner functions below are sent to a node as code, not by name, as they must also run, and report, on a node that has no engine or
# another one. So each of them imports by name all that it uses.


def node_probe() -> Callable[[], str]:
    """A function that returns the edition of the engine on the node where it runs, or says that there is none."""
    name = NODE

    def say_edition() -> str:
        import importlib

        try:
            return str(importlib.import_module(name).edition())
        except ImportError as error:
            return f"lacks the engine ({error})"

    return say_edition


def _task() -> Callable[..., Generator[dict[str, Any], None, None]]:
    name = NODE

    def work(order: Any, paths: list[str], contents: list[Any], wanted: str) -> Generator[dict[str, Any], None, None]:
        """Run an order and yield its messages, if the node has the edition `wanted`; `paths` and `contents` are of its files."""
        import importlib

        import ray

        try:
            node = importlib.import_module(name)
        except ImportError as error:
            yield {"type": "failed", "message": f"The node {ray.util.get_node_ip_address()} lacks the engine: {error}."}
            return
        if node.edition() != wanted:
            yield {"type": "failed", "message": f"The node {ray.util.get_node_ip_address()} has the engine {node.edition()}, not {wanted}."}
            return
        yield {"type": "placed", "node": ray.get_runtime_context().get_node_id()}
        yield from node.carry_out(order, dict(zip(paths, ray.get(contents), strict=True)))

    return work
