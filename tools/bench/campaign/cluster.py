"""Hands of other computers: a Dask cluster. The one door to `distributed`.

A worker needs this project at the same commit, its folder of BARN worlds at the same path, and one
thread (`dask worker ADDRESS --nworkers 8 --nthreads 1`). One that dies costs the flights it had in
the air: the scheduler gives them to others.
"""

import functools
from collections.abc import Callable, Generator, Sequence
from typing import Any

from autonomy.errors import BadInput
from autonomy.warm import warm_up
from tools.campaign import C, Hands, R
from tools.versions import commit

_ANSWER_S = 20.0


class OtherCommit(BadInput):
    """A worker runs something else."""


def cluster(address: str, *, answer_s: float = _ANSWER_S) -> Hands:
    """Whoever works for the scheduler at `address` (tcp://HOST:PORT). BadInput where none does."""
    dask = _distributed()

    def fly_all(missing: Sequence[C], fly: Callable[[C], R]) -> Generator[R, None, None]:
        try:
            client = dask.Client(address, timeout=answer_s, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BadInput(f"no scheduler answers at {address} ({error})") from None
        with client:
            flying = functools.partial(_warm, commit(), fly)
            futures = client.map(flying, missing, pure=False, retries=1)
            for future, row in dask.as_completed(futures, loop=client.loop, with_results=True):
                yield row
                future.release()

    return fly_all


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise BadInput(
            "a cluster needs distributed; install it with: pip install 'autonomy[cluster]'"
        ) from None
    return distributed


def _warm(expected: str, fly: Callable[[C], R], case: C) -> R:
    """In a worker: compiled before the first flight, and of the same commit."""
    if commit() != expected:
        raise OtherCommit(f"a worker runs commit {commit()}, this is {expected}: bring it there")
    _warm_up_once()
    return fly(case)


@functools.cache
def _warm_up_once() -> None:
    warm_up()
