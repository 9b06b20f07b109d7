"""The catalogue: every module of this folder that defines an :class:`Effect` is in it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

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


def kind_of(name: str, form: str = "") -> type[Effect]:
    """Return the class of a name; another realisation is a subclass that shares the name.

    Raises
    ------
    ValueError
        When the name has no such form.
    """
    usual = CATALOGUE[name]
    others = {kind.form: kind for kind in usual.__subclasses__() if kind.form}
    forms = {"": usual, **others}
    if form not in forms:
        known = ", ".join(f"'{known}'" for known in others) or "none"
        raise ValueError(f"{name} has no form '{form}' (forms: {known})")
    return forms[form]
