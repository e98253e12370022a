//! Exported policies in an independent ONNX runtime, and contracts compared with their tasks.

use nerd_tasks::formula::{Number, Sight, Traced};
use nerd_tasks::{About, Task};
use nerd_train::onnx::{Contract, Law, export, model};
use nerd_train::ppo::folder::load;
use rten::{Model, Value};

use crate::*;

/// Largest difference of actions.
const ALIKE: f64 = 1e-5;

/// Actions of a model for frames `[env][frame][number]`, the newest first.
fn elsewhere(model: &Model, shape: &Shape, frames: &[f64]) -> Vec<f64> {
    let sizes: &[usize] = &[frames.len() / shape.inputs(), shape.stack, shape.observation];
    let sizes = if shape.stack == 1 { &[sizes[0], sizes[2]] } else { sizes };
    let input = Value::from_shape(sizes, frames.iter().map(|x| *x as f32).collect::<Vec<f32>>())
        .expect("as many as they should be");
    let answer = model.run_one((&input).into(), None).expect("it runs");
    let (_, actions) = answer.into_shape_vec::<f32, 2>().expect("rows of numbers");
    actions.into_iter().map(f64::from).collect()
}

/// Largest difference between the actions of a policy and of its model, over steps of four environments under the
/// policy. Both get the same observations, in f32.
fn apart(policy: &Policy, task: &str, steps: usize) -> f64 {
    let model = Model::load(model(policy)).expect("a model");
    let (mut episodes, shape) =
        (Arena::Solver(SolverSpec::default()).episodes(task, 4, 11).expect("episodes"), &policy.shape);
    let seen = |of: &[f64]| -> Vec<f64> { of.iter().map(|x| f64::from(*x as f32)).collect() };
    let begun =
        |of: &[f64]| -> Vec<f64> { of.chunks(shape.observation).flat_map(|now| now.repeat(shape.stack)).collect() };
    let first = seen(episodes.observations());
    let (actor, mut stack) = (Actor::new(policy.clone()), Stack::new(shape.stack, shape.observation, &first));
    let (mut frames, mut worst) = (begun(&first), 0.0f64);
    for _ in 0..steps {
        let actions = actor.mean(&stack.rows);
        let theirs = elsewhere(&model, shape, &frames);
        assert!(actions.len() == theirs.len() && theirs.iter().all(|a| a.abs() <= 1.0), "{theirs:?}");
        worst = actions.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        let result = episodes.step(&actions).expect("a step");
        let (reached, fresh) = (seen(&result.reached), seen(episodes.observations()));
        let ended = |env: usize| result.terminated[env] || result.truncated[env];
        stack.push(&reached, &[], ended, &fresh, &mut Vec::new());
        let fresh = begun(&fresh);
        for (env, row) in frames.chunks_exact_mut(shape.inputs()).enumerate() {
            row.copy_within(..shape.inputs() - shape.observation, shape.observation);
            row[..shape.observation].copy_from_slice(&reached[env * shape.observation..][..shape.observation]);
            if ended(env) {
                row.copy_from_slice(&fresh[env * shape.inputs()..][..shape.inputs()]);
            }
        }
    }
    worst
}

/// A thousand observations for each policy, also where episodes begin anew.
#[test]
fn shipped_policies_act_elsewhere_as_they_act_here() {
    let all = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/policies")).expect("shipped policies");
    let (mut count, mut stacked, mut worst) = (0, 0, 0.0f64);
    for path in all.map(|entry| entry.expect("a folder").path()).filter(|path| path.join("config.json").exists()) {
        let (config, policy) = load(&path).expect("a policy");
        let gap = apart(&policy, &config.task, 250);
        assert!(gap < ALIKE, "{}: off by {gap:.1e}", path.display());
        (count, stacked, worst) = (count + 1, stacked + usize::from(policy.shape.stack > 1), worst.max(gap));
    }
    println!("{count} policies, {stacked} of several observations, off by {worst:.1e} at most");
    assert!(count > 0 && stacked > 0, "no policies are shipped");
}

/// Large weights, so that actions reach their bounds.
#[test]
fn every_activation_and_stack_has_its_operators() {
    for (activation, stack) in
        [(Activation::Gelu, 1), (Activation::Relu, 2), (Activation::Elu, 3), (Activation::Tanh, 4)]
    {
        let mut policy = policy(13, stack, 7, &[24, 16], activation);
        policy.flat.iter_mut().for_each(|w| *w *= 3.0);
        let gap = apart(&policy, "franka-reach-torque", 200);
        assert!(gap < ALIKE, "{activation:?}, {stack} observations: off by {gap:.1e}");
    }
}

/// Exports a policy of a task and reads its contract.
fn written(task: &str, stack: usize) -> Contract {
    contract(&*named(task).expect("registered"), stack)
}

fn contract(task: &dyn Task, stack: usize) -> Contract {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("policy.onnx");
    let policy = policy(task.observation_dim(), stack, task.action_dim(), &[8], Activation::Elu);
    let contract = export(&policy, task, &out).expect("written");
    let text = std::fs::read_to_string(folder.path().join("policy.json")).expect("beside it");
    assert_eq!(serde_json::from_str::<Contract>(&text).expect("a contract"), contract, "{}", task.name());
    assert!(export(&policy, task, &folder.path().join("policy.json")).is_err(), "one would be where the other is");
    contract
}

#[test]
fn a_contract_says_what_every_number_is() {
    let anymal = written("anymal-forward", 1);
    assert_eq!(anymal.unknown(), Vec::<String>::new());
    assert!(
        anymal.law == Law::Position { relative: false, stable_pd: true, servo: false }
            && (anymal.rate - 60.0).abs() < 1e-9,
        "{anymal:?}"
    );
    let names =
        |k: usize| (anymal.observation[k].quantity.as_deref().unwrap_or_default(), anymal.observation[k].of.as_str());
    assert_eq!(
        [0, 4, 5, 10].map(names),
        [("root position", "y"), ("root quaternion", "w"), ("root velocity", "x"), ("root angular velocity", "z")]
    );
    assert_eq!(
        [11, 23, 35, 36].map(names),
        [
            ("joint position", "RH_HAA"),
            ("joint velocity", "RH_HAA"),
            ("root axis along world axis", "z y"),
            ("root axis along world axis", "x x"),
        ]
    );
    let knee = &anymal.action[2];
    assert_eq!((knee.joint.as_str(), knee.unit.as_str(), knee.scale, knee.default_q), ("RH_KFE", "rad", 0.5, -0.8));
    assert_eq!((knee.kp, knee.kd, knee.torque_limit), (85.0, 2.0, None));
    // A driven cart, and a pole without a motor at an angle that wraps.
    let cartpole = written("cartpole-swingup", 1);
    assert!(cartpole.law == Law::Torque && cartpole.action.len() == 1 && cartpole.joints.len() == 2, "{cartpole:?}");
    assert_eq!((cartpole.action[0].scale, cartpole.action[0].unit.as_str()), (1500.0, "N"));
    assert_eq!(cartpole.observation[1].quantity.as_deref(), Some("joint position within [-pi, pi)"));
    // A vector to a point; a tool position, which no quantity describes; a task with its own control law.
    let point = written("ant-point", 1);
    assert!(
        point.unknown().is_empty() && point.observation[30].of == "2 z" && point.action[0].scale == 400.0,
        "{point:?}"
    );
    let franka = written("franka-reach", 3);
    assert!(
        franka.unknown().len() == 1 && franka.unknown()[0].contains("observation 7, 8, 9:"),
        "{:?}",
        franka.unknown()
    );
    assert!(
        franka.law == Law::Position { relative: true, stable_pd: false, servo: false } && franka.frames_per_action == 2,
        "{:?}",
        franka.law
    );
    assert!(
        franka.observations_seen == 3 && franka.input == "observations" && franka.action[6].torque_limit == Some(12.0),
        "{franka:?}"
    );
    assert!(written("lead-tip", 1).law == Law::Own);
    let walk = written("walk@anymal", 1);
    let last = walk.observation.last().and_then(|seen| seen.quantity.as_deref());
    assert!(walk.unknown().is_empty() && last == Some("last action") && (walk.rate - 50.0).abs() < 1e-9, "{walk:?}");
    assert_eq!(walk.commands[2], ("yaw_rate".to_string(), [-1.0, 1.0]));
    // A clock is a quantity, its sine and cosine are not.
    let gait = written(concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-tasks/tests/tasks/gait.toml@anymal"), 1);
    let time = &gait.observation[5];
    assert!(
        time.quantity.as_deref() == Some("time since the episode began") && (&*time.unit, time.scale) == ("s", 1.0),
        "{time:?}"
    );
    assert!(gait.unknown().len() == 1 && gait.unknown()[0].contains("observation 3, 4:"), "{:?}", gait.unknown());
}

/// A task in Rust that writes quantities in its own ways.
struct Ways;

impl Task for Ways {
    fn about(&self) -> About {
        About { name: "ways", robot: "ant", scene: "ground", observation: 6, action: 8, steps: 10, frames: 1 }
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        let [_, y, z, w] = [3, 4, 5, 6].map(|k| sight.q(k));
        let spin = [0, 1, 2].map(|k| sight.qd(k));
        // For a normalised quaternion; then a joint in steps; the velocity of the root with its terms in another order.
        out[0] = 1.0 - 2.0 * (z.squared() + y.squared());
        out[1] = 0.5 * (sight.q(8) - 1.0) + sight.q(8) / 4.0;
        out[2] = spin[0] * sight.q(1) - (sight.q(0) * spin[1] - sight.qd(5));
        // No random state reaches this bound; the next is a square; the last cancels.
        out[3] = sight.qd(7).min(1e3.into());
        out[4] = sight.qd(7).squared();
        out[5] = (w + 2.0).squared() - w.squared() - 4.0 * w;
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        sight.controlled(action, torques);
        torques[0] = 0.5 * torques[0] + torques[0] * 0.25;
    }

    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        sight.q(0)
    }
}

#[test]
fn a_contract_names_a_quantity_however_it_is_written() {
    let ways = contract(&Ways, 1);
    let told = |k: usize| {
        let seen = &ways.observation[k];
        (seen.quantity.as_deref().unwrap_or("none"), seen.of.as_str(), seen.scale, seen.offset)
    };
    assert_eq!(told(0), ("root axis along world axis", "x x", 1.0, 0.0));
    let joint = ways.joints[1].as_str();
    assert_eq!(told(1), ("joint position", joint, 0.75, -0.5));
    assert_eq!(told(2), ("root velocity", "z", 1.0, 0.0));
    assert_eq!([told(3), told(4)], [("none", "", 0.0, 0.0); 2]);
    assert_eq!(told(5), ("constant", "", 0.0, 4.0));
    let scales: Vec<f64> = ways.action.iter().map(|action| action.scale).collect();
    assert_eq!((ways.law, &scales[..2]), (Law::Torque, &[300.0, 400.0][..]));
}
