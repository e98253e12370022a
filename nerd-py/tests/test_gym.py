"""Tasks as Gymnasium has them: its checker, ends and restarts, seeds, the command line's own episodes."""

import json

import gymnasium
import nerd
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

IDS = {name: "nerd/" + "".join(part.capitalize() for part in name.split("-")) + "-v0" for name in nerd.Task.names()}
GENERAL = {"stand": "anymal", "reach": "franka"}


@pytest.mark.filterwarnings("ignore:.*Box observation space m.*infinity")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", [*nerd.Task.names(), *nerd.Task.general()])
def test_gymnasium_finds_nothing_to_complain_of(name):
    if name in nerd.Task.general():
        env = gymnasium.make(f"nerd/{name.capitalize()}-v0", robot=GENERAL.get(name, "ant"))
    else:
        env = gymnasium.make(IDS[name])
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


def actions(env, seed=0):
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-1.0, 1.0, env.action_space.shape)


def rolled(env, steps, seed=3):
    """Everything that comes of random actions."""
    out, draw = [env.reset(seed=seed)[0]], actions(env)
    for _ in range(steps):
        out.append(env.step(next(draw)))
    return out


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_ends_are_as_in_gymnasiums_own_vector(mode):
    ours = nerd.make_vec("franka-reach", n=3, autoreset_mode=mode)
    length = ours._task.steps
    seen, ended = rolled(ours, length + 3), length
    observations, rewards, terminated, truncated, infos = seen[ended]
    assert truncated.all() and not terminated.any()
    after = seen[ended + 1]
    if mode == AutoresetMode.SAME_STEP:
        assert infos["_final_obs"].all() and infos["final_obs"].dtype == object
        assert not any((infos["final_obs"][env] == observations[env]).all() for env in range(3))
        assert (after[1] != 0).all(), "the next step is one of the new episode"
    else:
        assert "final_obs" not in infos
        assert (after[1] == 0).all() and not (after[2] | after[3]).any()
        fresh = after[0]
        twin = nerd.make_vec("franka-reach", n=3, autoreset_mode=AutoresetMode.SAME_STEP)
        assert (fresh == rolled(twin, length)[length][0]).all(), "the same second episodes, whichever way they begin"
    twin = nerd.make_vec("franka-reach", n=3, autoreset_mode=mode)
    for one, two in zip(seen[1:], rolled(twin, length + 3)[1:]):
        assert all((a == b).all() for a, b in zip(one[:4], two[:4])), "same seed, same bytes"


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_environments_that_end_at_their_own_times(mode):
    """Ants that fall, each at a step of its own, hold up no other."""
    n, steps = 4, 400
    env = nerd.make_vec("ant-run", n=n, autoreset_mode=mode)
    seen = rolled(env, steps)
    ends = [step for step, result in enumerate(seen) if step and (result[2] | result[3]).any()]
    assert ends, "no Ant fell"
    for step in ends:
        ended = seen[step][2] | seen[step][3]
        if step == steps:
            continue
        held = seen[step + 1]
        if mode == AutoresetMode.NEXT_STEP:
            assert (held[1][ended] == 0).all() and not (held[2] | held[3])[ended].any()
            assert (held[1][~ended] != 0).all(), "the others go on"
        else:
            assert (held[1][ended] != 0).all()


def test_disabled_autoreset_asks_for_a_mask():
    env = nerd.make_vec("franka-reach", n=3, autoreset_mode=AutoresetMode.DISABLED)
    seen, draw = rolled(env, env._task.steps), actions(env, 1)
    assert seen[-1][3].all()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(next(draw))
    mask = np.array([True, False, True])
    observations, _ = env.reset(options={"reset_mask": mask})
    assert (observations[mask] != seen[-1][0][mask]).any(axis=1).all()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(next(draw))
    env.reset(options={"reset_mask": ~mask})
    env.step(next(draw))


def test_a_vector_is_its_environments_and_spaces_fit():
    env = nerd.make_vec("ant-run", n=5)
    observations, _ = env.reset(seed=11)
    assert env.observation_space.contains(observations) and env.action_space.contains(env.action_space.sample())
    assert env.observation_space.shape == (5, *env.single_observation_space.shape)
    single = gymnasium.make("nerd/AntRun-v0").unwrapped
    first, _ = single.reset(seed=11)
    assert (first == observations[0]).all()
    draw = actions(env)
    for _ in range(20):
        action = next(draw)
        several, one = env.step(action), single.step(action[0])
        assert (several[0][0] == one[0]).all() and several[1][0] == one[1]
    by_id = gymnasium.make_vec("nerd/AntRun-v0", num_envs=5)
    assert (by_id.reset(seed=11)[0] == observations).all()


def test_seeds_and_resets():
    env = nerd.make_vec("ant-run", n=4)
    one, _ = env.reset(seed=1)
    two, _ = env.reset()
    three, _ = env.reset()
    assert (one != two).any(axis=1).all() and (two != three).any(axis=1).all()
    again, _ = env.reset(seed=1)
    assert (again == one).all() and (env.reset()[0] == two).all()
    one = gymnasium.make("nerd/AntRun-v0").unwrapped
    assert (one.reset(seed=np.int64(1))[0] == again[0]).all()
    wrong = [{"seed": seed} for seed in (-1, 2**63, [1, 2, 3, 4], np.arange(2000), "a", 1.5, True)]
    for asked in wrong + [{"options": options} for options in (3, "reset_mask", [], {"mask": 1}, {1: np.zeros(2000)})]:
        for any_env in (env, one):
            with pytest.raises(ValueError, match=f"^{[*asked][0]}: [^\n]*$"):
                any_env.reset(**asked)
    unseeded = [nerd.make_vec("ant-run", n=1).reset()[0] for _ in range(2)]
    assert (unseeded[0] != unseeded[1]).any()


@pytest.mark.parametrize(
    "asked",
    [{"n": 2.5}, {"n": "3"}, {"n": True}, {"n": 2**70}, {"n": 0}, {"n": 10**9}, {"task": 3}, {"robot": 3}, {"robot": ["ant"]}, {"solver": None}]
    + [{"family": float("nan")}, {"autoreset_mode": "x"}, {"device": "gpu"}, {"solver": "nothing"}, {"robot": "nothing.urdf"}],
)
def test_what_makes_no_sense_is_refused_in_one_line_by_its_name(asked):
    with pytest.raises((TypeError, ValueError)) as error:
        nerd.make_vec(**{"task": "walk", "robot": "ant"} | asked)
    [(name, value)] = asked.items()
    said = str(error.value)
    assert "\n" not in said and (said.startswith(name) or str(value) in said), said


@pytest.mark.parametrize("solver", ["articulated", "neural", "rapier"])
def test_every_solver_plays(solver):
    env = nerd.make_vec("cartpole-swingup", n=3, solver=solver)
    result = rolled(env, 5)[-1]
    assert np.isfinite(result[0]).all() and np.isfinite(result[1]).all()


@pytest.mark.parametrize("task, mode", [("ant-run", "next_step"), ("anymal-forward", "same_step"), ("ant-spin", "disabled")])
def test_episodes_are_those_of_the_command_line_to_the_bit(task, mode, models, tmp_path):
    policy = nerd.Policy(models / f"policies/{task}-articulated-0")
    assert policy.task == task
    n, seed = 6, 77
    env = nerd.make_vec(task, n=n, autoreset_mode={m.name.lower(): m for m in AutoresetMode}[mode])
    assert policy.inputs == env._task.observation, "it remembers nothing"
    rewards, lengths = policy.play(n, seed)
    sums, steps, over = np.zeros(n), np.zeros(n), np.zeros(n, bool)
    observations, _ = env.reset(seed=seed)
    while not over.all():
        observations, reward, terminated, truncated, _ = env.step(policy(observations))
        for k in np.flatnonzero(~over):
            sums[k] += reward[k]
            steps[k] += 1
        over |= terminated | truncated
        if mode == "disabled" and (terminated | truncated).any():
            observations, _ = env.reset(options={"reset_mask": terminated | truncated})
    assert (sums == rewards).all() and (steps == lengths).all(), (sums, rewards)
    options = dict(policy=models / f"policies/{task}-articulated-0", episodes=n, seed=seed, truth_only=True, name="played", out=tmp_path)
    assert nerd.run("policy", "evaluate", **options), "a table"
    row = json.loads((tmp_path / "played/result.json").read_text())["rows"][0]
    # As the command line adds them up.
    assert row["real"]["mean"] == sum(sums.tolist()) / n and row["real"]["length"] == sum(steps.tolist()) / n


def test_an_environment_shows_its_robot_and_takes_another_solver():
    env = nerd.make_vec("ant-run", n=2)
    env.reset(seed=5)
    before = env.states
    env.swap("rapier")
    assert env.system.name == "ant" and (env.states == before).all() and before.shape == (2, 29)
    twin = nerd.make_vec("ant-run", n=2, solver="rapier")
    twin.reset(seed=5)
    assert (env.step(np.ones((2, 8)))[0] == twin.step(np.ones((2, 8)))[0]).all()
    assert env.task.name == "ant-run"


def test_an_episode_that_ended_asks_for_a_reset():
    env = gymnasium.make("nerd/FrankaReach-v0").unwrapped
    env.reset(seed=0)
    for _ in range(env.task.steps):
        truncated = env.step(np.zeros(env.task.action))[3]
    assert truncated
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(env.task.action))
    env.reset()
    env.step(np.zeros(env.task.action))


def test_stable_baselines_learns_on_them():
    sb3 = pytest.importorskip("stable_baselines3")
    from nerd.sb3 import VecEnv

    from stable_baselines3.common.env_util import make_vec_env

    env, twin = VecEnv("nerd/FrankaReach-v0", n=3), nerd.make_vec("franka-reach", n=3, autoreset_mode=AutoresetMode.SAME_STEP)
    env.seed(3)
    assert (env.reset() == np.float32(twin.reset(seed=3)[0])).all()
    draw = actions(twin)
    for _ in range(twin.task.steps):
        action = next(draw)
        (observations, rewards, ended, infos), (wanted, sums, _, _, of) = env.step(action), twin.step(action)
        assert (observations == np.float32(wanted)).all() and (rewards == np.float32(sums)).all()
    assert ended.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert (infos[1]["terminal_observation"] == np.float32(of["final_obs"][1])).all()
    for learned in (env, make_vec_env("nerd/CartpoleSwingup-v0", n_envs=2)):
        sb3.PPO("MlpPolicy", learned, n_steps=16, batch_size=16, device="cpu").learn(64)


def test_environments_of_a_family_differ():
    one, two = (nerd.make_vec("nerd/AntRun-v0", robot=nerd.System("ant"), n=2, family=family) for family in (None, "ant-family"))
    for env in (one, two):
        env.reset(seed=1)
    assert (one.states == two.states).all()
    action = np.ones((2, 8))
    assert (one.step(action)[0] != two.step(action)[0]).any(axis=1).all()


def test_terms_add_up_to_the_reward(root, tmp_path):
    text = (root / "nerd-tasks/assets/cartpole-swingup.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("reward =")]
    terms = ["[reward]", 'upright = "5 - angle.squared()"', 'slow = "-qd[1].squared()"']
    (tmp_path / "mine.toml").write_text("\n".join([*lines, *terms]), encoding="utf-8")
    env, one = nerd.make_vec(tmp_path / "mine.toml", n=3), gymnasium.make("nerd/CartpoleSwingup-v0", task=tmp_path / "mine.toml").unwrapped
    one.reset(seed=3)
    for _, reward, *_, infos in rolled(env, 5)[1:]:
        assert set(infos["terms"]) == {"upright", "slow"} and np.allclose(sum(infos["terms"].values()), reward, atol=1e-12)
    _, reward, *_, info = one.step(np.zeros(env.task.action))
    assert sum(info["terms"].values()) == pytest.approx(reward) and "terms" not in rolled(nerd.make_vec("ant-run"), 1)[1][4]


def test_gymnasiums_own_vector_takes_them():
    env = SyncVectorEnv([lambda: gymnasium.make("nerd/CartpoleSwingup-v0")] * 2)
    assert np.isfinite(rolled(env, 5)[-1][0]).all()


def test_what_is_wrong_is_refused():
    with pytest.raises(ValueError, match="no task"):
        nerd.make_vec("ant-fly")
    with pytest.raises(ValueError):
        nerd.make_vec("walk")
    with pytest.raises(ValueError, match="learned robot `ant` with hash"):
        nerd.make_vec("walk", robot="nerd-sim/assets/ant.urdf", solver="neural")
    with pytest.raises(ValueError, match="n=0"):
        nerd.make_vec("ant-run", n=0)
    for options in ({"device": "cuda"}, {"xp": np}, {"device": "tpu", "xp": np}):
        with pytest.raises(ValueError, match="xp="):
            nerd.make_vec("ant-run", **options)
    with pytest.raises(ValueError, match="cuda|same step"):
        nerd.make_vec("ant-run", device="cuda", xp=np, autoreset_mode="NextStep")
    # After which Stable-Baselines3 asks without it.
    with pytest.raises(TypeError, match="render_mode"):
        gymnasium.make("nerd/AntRun-v0", render_mode="rgb_array")
    env = nerd.make_vec("ant-run", n=2)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((2, 8)))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="actions"):
        env.step(np.zeros((3, 8)))
    with pytest.raises(ValueError, match="environment 1 has NaN"):
        env.step(np.where(np.arange(2) == 1, np.nan, np.zeros((8, 2))).T.copy())
    with pytest.raises(ValueError, match="is for `cartpole`"):
        nerd.make_vec("cartpole-swingup", robot="pendulum")
    with pytest.raises(NotImplementedError, match="policy show"):
        env.render()
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": [True, False]})
