"""Moves the grip of robot_arm.fmu to a point: a master of co-simulation with the controller.

sparsemor reduce robot_arm.yaml --out robot_arm.model
sparsemor export robot_arm.model --to fmu
python robot_arm.py robot_arm.fmu robot_arm.png
"""

import sys

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

STEP, END, LENGTHS = 1e-3, 2.0, (0.6, 0.5)          # s, s, m
GOAL = (0.3, 0.8)                                     # m
STIFFNESS, DAMPING = (200.0, 60.0), (20.0, 5.0)        # N m/rad, N m s/rad
RISE = 1.0                                            # s


def angles_at(x: float, y: float) -> np.ndarray:
    """Angles of both joints, rad, that take the grip of rigid links to (x, y), m."""
    a, b = LENGTHS
    elbow = np.arccos((x * x + y * y - a * a - b * b) / (2.0 * a * b))
    upper = np.arctan2(y, x) - np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
    return np.array([upper, elbow])


def path(t: float, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wanted angles and their rates: from the straight arm, at rest at both ends."""
    s = min(t / RISE, 1.0)
    return s**3 * (10 - 15 * s + 6 * s * s) * goal, 30 * s * s * (1 - s) ** 2 / RISE * goal


def master(unit: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, grip (n, 2) and torques (n, 2) of a run with the controller in each step."""
    about = read_model_description(unit)
    number = {v.name: v.valueReference for v in about.modelVariables}
    arm = FMU2Slave(guid=about.guid, unzipDirectory=extract(unit), instanceName="arm",
                    modelIdentifier=about.coSimulation.modelIdentifier)
    arm.instantiate()
    arm.setupExperiment(startTime=0.0)
    arm.enterInitializationMode()
    arm.exitInitializationMode()
    sensors = [number[f"{part}.rigid.{what}"] for what in ("angle", "angle_rate")
               for part in ("shoulder_rotor", "elbow_rotor", "elbow_stator")]
    grip, motors = [number["grip.x"], number["grip.y"]], [
        number[f"joints.{joint}_motor.torque"] for joint in ("shoulder", "elbow")]
    goal, kept = angles_at(*GOAL), []
    for step in range(round(END / STEP)):
        t = step * STEP
        read = np.array(arm.getReal(sensors))
        q, rate = read[:2] - [0.0, read[2]], read[3:5] - [0.0, read[5]]
        wanted, speed = path(t, goal)
        torque = np.array(STIFFNESS) * (wanted - q) + np.array(DAMPING) * (speed - rate)
        arm.setReal(motors, torque.tolist())
        arm.doStep(t, STEP)
        kept.append([t + STEP, *arm.getReal(grip), *torque])
    arm.terminate()
    arm.freeInstance()
    found = np.array(kept)
    return found[:, 0], found[:, 1:3], found[:, 3:]


def draw(times: np.ndarray, grip: np.ndarray, torque: np.ndarray, file: str) -> None:
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9, 4), layout="constrained")
    left.plot(*grip.T, color="#0072B2", label="grip")
    left.plot(*GOAL, "+", color="#D55E00", markersize=14, label="goal")
    left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    left.legend(frameon=False)
    for values, name, colour, dash in zip(torque.T, ("shoulder", "elbow"), ("#0072B2", "#D55E00"),
                                          ("-", "--"), strict=True):
        right.plot(times, values, color=colour, linestyle=dash, label=name)
    right.set(xlabel="time (s)", ylabel="torque of the motor (N m)")
    right.legend(frameon=False)
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    times, grip, torque = master(sys.argv[1])
    print(f"grip at {1e3 * grip[-1, 0]:.2f}, {1e3 * grip[-1, 1]:.2f} mm, "
          f"goal {1e3 * GOAL[0]:.0f}, {1e3 * GOAL[1]:.0f} mm, "
          f"largest torque {np.abs(torque).max():.2f} N m")
    draw(times, grip, torque, sys.argv[2])
