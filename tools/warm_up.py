"""Compile every numba kernel into its cache, so that nobody's first command waits for it.

The build calls this; the two packages compile side by side.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module

WORK = (
    ("imu_noise_id.allan", "imu_noise_id.cca", "imu_noise_id.joint_cca", "imu_noise_id.phase"),
    ("nav_fusion.fuse",),
)


def warm_up(modules: tuple[str, ...]) -> None:
    """Call ``warm_up`` of each module."""
    for module in modules:
        import_module(module).warm_up()


if __name__ == "__main__":
    with ProcessPoolExecutor(len(WORK)) as pool:
        list(pool.map(warm_up, WORK))
    sys.exit(0)
