"""Connection to a running Dask cluster, given by its address."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from plop.errors import PlopError
from plop.installed import install_extra

ANSWER_S = 5.0
"""How long a scheduler may take to answer [s]."""


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to a Dask scheduler while the block runs.

    Args:
        address: For example tcp://10.0.0.5:8786.

    Yields:
        The `distributed.Client`, which is the default one meanwhile.

    Raises:
        PlopError: Dask is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise PlopError(
            "A Dask scheduler needs the package distributed.",
            expected="distributed",
            found=str(error),
            fix=f"{install_extra('cluster')}; or leave --scheduler out.",
        ) from error
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=True)
    except (OSError, TimeoutError, ValueError) as error:
        raise PlopError(
            "The Dask scheduler cannot be reached.",
            where=address,
            expected="an address such as tcp://host:8786",
            found=str(error) or "no answer",
            fix="Start `dask scheduler` and workers (docs/how-to/cluster.md), or leave --scheduler out.",
        ) from error
    try:
        yield client
    finally:
        client.close()
