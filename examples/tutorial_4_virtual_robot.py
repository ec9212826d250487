# %% [markdown]
# # 4. The virtual robot
#
# Does a controller that was designed in the simulator also hit on a robot? The virtual robot `infantry` answers this
# without hardware. It has other physics than our simulator (MuJoCo, with friction, a firmware, a link with losses, a
# camera with latency), and the identification sees nothing of it but logs.

# %%
import archerfish as af

virtual = af.VirtualRobot.load("infantry")
virtual.record("infantry_logs", seed=1)  # the same logs as a team records: sweeps, steps, shots, camera timing
found = af.identify_robot("infantry_logs")
print(found.report.headline)
robot = found.record
print(robot)

# %% [markdown]
# Now the same controllers shoot twice at the same targets with the same dispersion: in the simulator that was built
# from the logs, and on the virtual robot itself (`world=virtual`).

# %%
task = af.Task.load("dynamic").replace(ranges_m=((2, 3), (4, 5)))
names = ["kalman", "no-lead"]
simulated = af.evaluate(names, robot, task, engagements=20, tuning="start")
measured = af.evaluate(names, robot, task, engagements=20, tuning="start", world=virtual)
print(simulated.join(measured))

# %% [markdown]
# The difference between the two tables is the sim-to-real gap:

# %%
for name in names:
    in_simulator, on_robot = (
        sum(cell.hits for cell in results.cells if cell.controller == name)
        / sum(cell.decisions for cell in results.cells if cell.controller == name)
        for results in (simulated, measured)
    )
    print(f"{name}: {in_simulator:.1%} in the simulator, {on_robot:.1%} on the virtual robot")

# %% [markdown]
# `archerfish transfer infantry` does all of this at full length, with trained policies, and reports every gap with its
# interval. [The virtual robot](virtual_robot.md) explains how to describe a robot of your own.
