"""Data sets of a sweep file on the engines of clusters.

Each picture is one task. Whatever the engine, the files are those of ``camrig batch SWEEP -o
DIRECTORY``, byte for byte; pictures that are there are kept, and a task whose worker was lost is
run again by the engine. Workers on other machines need sweep file and directory under the same
paths. Without an engine, ``camrig batch`` uses all processors of this machine.
"""

from __future__ import annotations

import functools
import importlib
import os
from os import PathLike
from typing import Any

from . import _camrig

__all__ = ["dask", "ray"]

_Path = str | PathLike[str]


@functools.lru_cache(maxsize=4)
def _opened(sweep: str, directory: str) -> _camrig._Batch:
    return _camrig._Batch(sweep, directory)


def _make(index: int, sweep: str, directory: str) -> None:
    _opened(sweep, directory).make(index)


def _begin(sweep: _Path, directory: _Path) -> tuple[dict[str, str], range]:
    _opened.cache_clear()  # of files that may have changed
    paths = {"sweep": os.path.abspath(sweep), "directory": os.path.abspath(directory)}
    return paths, range(len(_opened(**paths)))


def _finish(sweep: str, directory: str) -> None:
    if _camrig.main(["camrig", "batch", sweep, "-o", directory]) != 0:
        raise RuntimeError("camrig batch says on standard error what is wrong")


def dask(sweep: _Path, directory: _Path, client: Any) -> None:
    """Makes a data set on the workers of a Dask cluster.

    Parameters
    ----------
    sweep, directory : path
        As ``camrig batch SWEEP -o DIRECTORY`` has them.
    client : distributed.Client
        Of the cluster.
    """
    paths, pictures = _begin(sweep, directory)
    client.gather(client.map(_make, pictures, pure=False, **paths))
    _finish(**paths)


def ray(sweep: _Path, directory: _Path) -> None:
    """Makes a data set on the workers of a Ray cluster: that of ``ray.init``.

    Parameters
    ----------
    sweep, directory : path
        As ``camrig batch SWEEP -o DIRECTORY`` has them.
    """
    engine: Any = importlib.import_module("ray")
    paths, pictures = _begin(sweep, directory)
    make = engine.remote(_make)
    engine.get([make.remote(index, **paths) for index in pictures])
    _finish(**paths)
