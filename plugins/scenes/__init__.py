"""Packaged scenes: the names that `load` accepts for them, and their files."""

from pathlib import Path

_HERE = Path(__file__).parent

double_pendulum = _HERE / "double_pendulum.yaml"
double_pendulum_published = _HERE / "double_pendulum_published.yaml"
double_pendulum_recovered = _HERE / "double_pendulum_recovered.yaml"
slider_plate = _HERE / "slider_plate.yaml"
slider_plate_published = _HERE / "slider_plate_published.yaml"
slider_plate_recovered = _HERE / "slider_plate_recovered.yaml"
brake_disk = _HERE / "brake_disk.yaml"
brake_disk_published = _HERE / "brake_disk_published.yaml"
brake_disk_recovered = _HERE / "brake_disk_recovered.yaml"
hot_plate = _HERE / "hot_plate.yaml"
hot_pendulum = _HERE / "hot_pendulum.yaml"
