"""The catalogue: every module of this folder that defines an :class:`Effect` is in it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Collection

from imu_noise_id.effects.base import Effect


def _collect() -> dict[str, type[Effect]]:
    found: dict[str, type[Effect]] = {}
    for module_info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{module_info.name}")
        for _, item in inspect.getmembers(module, inspect.isclass):
            defined_here = item.__module__ == module.__name__
            if defined_here and issubclass(item, Effect) and "name" in vars(item):
                found[item.name] = item
    return dict(sorted(found.items()))


CATALOGUE: dict[str, type[Effect]] = _collect()


def kind_of(name: str, given: Collection[str]) -> type[Effect]:
    """Return the kind of a name that has the given parameters.

    Most names are one class; a realisation that needs a parameter more is a subclass, which shares
    the name.  The class of the catalogue where none has them all, for its reader to say so.
    """
    kind = CATALOGUE[name]
    realisations = (kind, *kind.__subclasses__())
    fitting = (k for k in realisations if {p.name for p in k.parameters}.issuperset(given))
    return next(fitting, kind)
