# %% [markdown]
# # A model in a planner's loop
#
# From nothing to a plan, with one import: simulate a few recordings, fit a model to them, look at its error, and let a
# planner choose actions with it. Run the cells one after the other (VS Code and Jupytext open this file as a notebook),
# or the whole of it: `python docs/tutorials/planner.py`. It takes some minutes the first time and seconds after that:
# existing artifacts are reused.

# %%
import plop

store = plop.Store("planner")  # a folder; settings in planner/plop.toml are read as the commands do

# %% [markdown]
# ## Recordings and a model
# `plop.run` is the command of that name: `plop simulate block.toml --episodes 4 --name block -w planner`. It gives the
# artifact, and first makes the missing inputs: `identify` needs Gaussians and tracks of the recordings.

# %%
recordings = plop.run("simulate", store, scene="block.toml", episodes=4, name="block")
engine = plop.run("identify", store, recordings=recordings, name="engine")
fitted = store.find("fit-init@latest")
print(engine.address, engine.manifest.summary["figures"])

# %% [markdown]
# ## How wrong is it?
# A rollout sees the first frame and the motion of the tool, nothing else. `compare` scores it against the measured
# views as `plop eval` does.

# %%
model = plop.load_model(engine)
held_out = plop.RecordingSet.load(recordings).test[0]
with plop.RecordingSet.load(recordings).open(held_out) as recording:
    scene = plop.InitialScene.of(recording, fitted)
    states = plop.rollout(model, scene, recording)
    errors = plop.compare(states, scene, recording)
    poses = recording.world_from_tool  # [T, 4, 4]
    dt_s = float(recording.time_s[1] - recording.time_s[0])
print(f"{held_out}: Chamfer distance {errors['cd_mm'][-1]:.2f} mm in the last frame")
errors.plot().figure.savefig("error.png")

# %% [markdown]
# ## Plan with it
# A step is a pure function, `state = model.step(state, action)`: the state holds everything, and the model nothing. So
# one state can be stepped by several actions to see which is best, without copying or resetting the model.
#
# The goal: slide the object 10 mm along x. The tool starts where it was in the middle of the recording, and in each
# step the planner looks two steps ahead along a few directions.

# %%
STEP_M, AHEAD, STEPS = 0.003, 2, 4
DIRECTIONS = {"+x": (1, 0), "-x": (-1, 0), "+y": (0, 1), "-y": (0, -1), "stay": (0, 0)}
start = len(poses) // 2
state = states[start]
goal = state.gaussians.means.mean(0) + state.gaussians.means.new_tensor([0.010, 0.0, 0.0])


def moved(pose, direction):
    """Shift the tool's pose in the plane of the table."""
    after = pose.copy()
    after[:2, 3] += [STEP_M * way for way in direction]
    return after


def followed(state, pose, direction, count):
    """Step the model along one direction; return the state and the pose at the end."""
    for _ in range(count):
        after = moved(pose, direction)
        state = model.step(state, scene.action(pose, after, dt_s))
        pose = after
    return state, pose


def distance_m(state):
    """How far the object's centre is from the goal [m]."""
    return float((state.gaussians.means.mean(0) - goal).norm())


# %%
pose, plan = poses[start], []
for _ in range(STEPS):
    reached = {name: distance_m(followed(state, pose, way, AHEAD)[0]) for name, way in DIRECTIONS.items()}
    best = min(reached, key=reached.get)
    state, pose = followed(state, pose, DIRECTIONS[best], 1)
    plan.append(best)
before, after = (1000 * distance_m(one) for one in (states[start], state))
print(f"plan {plan}: {before:.1f} mm from the goal before, {after:.1f} mm after")

# %% [markdown]
# ## What if the physics were different?
# An effect of the library can be added to a model; the model itself stays as it is.

# %%
stiffer = plop.augment(model, plop.effect_type("stiffness")(d_ln_e=0.5))
other = plop.rollout(stiffer, scene, [scene.action(a, b, dt_s) for a, b in zip(poses[:-1], poses[1:], strict=True)])
way = (other[-1].gaussians.means - states[-1].gaussians.means).norm(dim=1)
print(f"65 % stiffer, the object ends {1000 * float(way.mean()):.2f} mm elsewhere")
