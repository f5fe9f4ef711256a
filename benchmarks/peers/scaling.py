"""Table V: time and memory of one step by the number of particles, all models in turn in one run.

The particles fill a constant volume, as in the paper: more of them lie closer together. DPI-Net is measured with all
edges within its radius as published (index and dense form), and with the twelve nearest only.
"""

from __future__ import annotations

import multiprocessing
import resource
import signal
import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from benchmarks.peers.dense import DensePropagationNetwork
from benchmarks.peers.particle_data import FEATURES, RADIUS_M
from benchmarks.peers.particle_models import OnAll, OnGraph, OnGrid, Units
from benchmarks.peers.particles import clock_s

COUNTS = (300, 1000, 2000, 5000, 10_000, 30_000, 100_000)
_ACROSS = 6
"""Radii across the cube of particles."""
_WARM_UP = 50
"""Particles of a step that is not measured: it loads kernels."""
_UNITS = Units(1.0, 1.0, _ACROSS * RADIUS_M)
MODELS: dict[str, Callable[[Units], nn.Module]] = {
    "i2n": OnGrid,
    "dpi-net, 12 neighbours": partial(OnGraph, most=12),
    "dpi-net": OnGraph,
    "dpi-net, dense": partial(OnGraph, network=DensePropagationNetwork),
    "transformer": OnAll,
}


def measured(
    counts: tuple[int, ...], limit_s: float, memory_gb: float, rounds: int, device: str = "cpu"
) -> dict[str, dict[str, Any]]:
    """Measure forward and training step on one thread; CPU time, which other programs hardly change; a GPU's wall time.

    Args:
        counts: Numbers of particles, ascending.
        limit_s: A model is not measured any more once both steps take more CPU time than this.
        memory_gb: A process may have so much memory.
        rounds: Repetitions; the models take turns.
        device: "cpu" or "cuda".

    Returns:
        Model -> number of particles -> {"forward_ms", "training_ms", "peak_mb"}, or {"left_out": why}.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    found: dict[str, dict[str, Any]] = {name: {} for name in MODELS}
    # First the memory, while this process, of which each trial is a copy, has not used any.
    for name, make in MODELS.items():
        row: dict[str, Any] = {}
        for count in counts:
            if "left_out" not in row:
                trial = _in_a_process if device == "cpu" else _on_the_gpu
                row = trial(make, count, memory_gb, limit_s)
            found[name][str(count)] = dict(row)
    for count in counts:
        running = {
            name: make(_UNITS).to(device) for name, make in MODELS.items() if "left_out" not in found[name][str(count)]
        }
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in running}
        for network in running.values():
            _timed(network, _WARM_UP)
        for _ in range(rounds):
            for name, network in running.items():
                times[name].append(_timed(network, count))
        for name, pairs in times.items():
            forward, training = (statistics.median(each) for each in zip(*pairs, strict=True))
            found[name][str(count)] |= {"forward_ms": round(forward, 2), "training_ms": round(training, 2)}
    torch.set_num_threads(threads)
    return found


def _cloud(count: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    positions = torch.rand(count, 3, generator=generator) * _ACROSS * RADIUS_M
    return positions, torch.randn(count, FEATURES, generator=generator)


def _timed(network: nn.Module, count: int) -> tuple[float, float]:
    """Time one forward and one training step, neighbours searched anew [ms]."""
    positions, features = _cloud(count)
    device = next(network.parameters()).device.type
    positions, features = positions.to(device), features.to(device)
    began = clock_s(device)
    with torch.no_grad():
        network([positions], [features])
    middle = clock_s(device)
    network.zero_grad()
    network([positions], [features])[0].square().mean().backward()
    return 1e3 * (middle - began), 1e3 * (clock_s(device) - middle)


def _on_the_gpu(make: Callable[[Units], nn.Module], count: int, memory_gb: float, limit_s: float) -> dict[str, Any]:
    """Try both steps; return the peak of the GPU's memory."""
    torch.cuda.set_per_process_memory_fraction(min(1.0, 1e9 * memory_gb / torch.cuda.mem_get_info()[1]))
    network = make(_UNITS).to("cuda")
    _timed(network, _WARM_UP)
    torch.cuda.empty_cache()
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    try:
        spent = 1e-3 * sum(_timed(network, count))
    except torch.OutOfMemoryError:
        return {"left_out": f"more than {memory_gb:g} GB"}
    if spent > limit_s:
        return {"left_out": f"longer than {limit_s:g} s"}
    return {"peak_mb": round((torch.cuda.max_memory_allocated() - before) / 2**20)}


def _in_a_process(make: Callable[[Units], nn.Module], count: int, memory_gb: float, limit_s: float) -> dict[str, Any]:
    """Try both steps in a process of its own, with limits of CPU time and memory; return the peak of its memory."""
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    process = context.Process(target=_peak, args=(make, count, memory_gb, limit_s, queue))
    process.start()
    process.join()
    if process.exitcode in (-signal.SIGXCPU, -signal.SIGKILL):
        return {"left_out": f"longer than {limit_s:g} s"}
    return dict(queue.get()) if process.exitcode == 0 else {"left_out": f"more than {memory_gb:g} GB"}


def _peak(make: Callable[[Units], nn.Module], count: int, memory_gb: float, limit_s: float, queue: Any) -> None:
    network = make(_UNITS)
    _timed(network, _WARM_UP)
    size = int(memory_gb * 1e9)
    resource.setrlimit(resource.RLIMIT_DATA, (size, size))
    seconds = max(1, round(limit_s))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        _timed(network, count)
    except (RuntimeError, MemoryError):  # torch's allocator raises RuntimeError
        queue.put({"left_out": f"more than {memory_gb:g} GB"})
        return
    queue.put({"peak_mb": round((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)})
