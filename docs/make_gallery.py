"""Draws the pictures of examples.md from runs of docs/examples.

    python docs/make_gallery.py [NAME ...]

Needs the extras gmsh and fmu, FMPy, and for bodies in space pictures3d.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib import pyplot
from matplotlib.image import imread

FOLDER = Path(__file__).parent
EXAMPLES = FOLDER / "examples"
WIDTH, HEIGHT = 600, 900
"""Largest size of a picture, pixels."""
MADE = {
    "engine": (("run {}/engine.yaml --out out", "pictures out --fields stress --at 0.004"),
               "out/pictures/stress_rod.png"),
    "gearbox_shaft": (("solve {}/gearbox_shaft.yaml steady_heat --out out",),
                      "out/steady_heat_shaft.png"),
    "cooled_brake": (("run {}/cooled_brake.yaml --out out", "pictures out --at 4,243"),
                     "out/pictures/temperature.png"),
    "blade": (("solve {}/blade.yaml frequencies --spin --count 3 --out out",),
              "out/frequencies_blade.png"),
    "circuit_board": (("run {}/circuit_board.yaml --out out", "pictures out --at 900"),
                      "out/pictures/temperature_board.png"),
    "calculix_rod": (("run {}/calculix_rod.yaml --out out", "pictures out"),
                     "out/pictures/probe_displacement.png"),
    "robot_arm": (("reduce {}/robot_arm.yaml --out arm.model",
                   "export arm.model --to fmu --out arm.fmu"), "robot_arm.png"),
}
"""Example -> commands, and the picture that they draw."""


def draw(name: str, folder: Path) -> None:
    """Runs the commands of an example and keeps its picture, made smaller."""
    commands, picture = MADE[name]
    program = Path(sys.executable).with_name("sparsemor")
    for command in commands:
        subprocess.run([program, *command.format(EXAMPLES).split()], cwd=folder, check=True)
    if name == "robot_arm":
        subprocess.run([sys.executable, EXAMPLES / "robot_arm.py", "arm.fmu", picture], cwd=folder,
                       check=True)
    pixels = imread(folder / picture)
    height, width = pixels.shape[:2]
    scale = min(WIDTH / width, HEIGHT / height) / 100
    figure = pyplot.figure(figsize=(scale * width, scale * height), dpi=100)
    figure.add_axes((0, 0, 1, 1)).axis("off")
    figure.axes[0].imshow(pixels, interpolation="antialiased", aspect="auto")
    figure.savefig(FOLDER / "gallery" / f"{name}.png", dpi=100,
                   pil_kwargs={"optimize": True})
    pyplot.close(figure)


if __name__ == "__main__":
    for name in sys.argv[1:] or MADE:
        with TemporaryDirectory() as work:
            draw(name, Path(work))
