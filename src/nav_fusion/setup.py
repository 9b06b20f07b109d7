from glob import glob

from setuptools import find_packages, setup

package = "nav_fusion"
commands = ["fuse", "budget", "play"]

setup(
    name=package,
    version="0.1.0",
    description="Fuse IMU and GNSS on an identified noise model; error budgets; replay of bags",
    maintainer="imu_noise_id maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={
        package: ["**/*.html", "**/*.css", "**/*.js", "**/*.yaml", "**/*.json", "**/*.j2"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/launch", glob("launch/*.launch.py")),
        (f"share/{package}/config", glob("config/*")),
    ],
    # what it imports is named by package.xml, the lower bounds by the workspace's pyproject.toml
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
        "console_scripts": [f"{name} = {package}.commands.{name}:main" for name in commands]
    },
)
