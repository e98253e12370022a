//! How actions become torques, found by asking the task at states drawn anywhere, as its observations are.

use nerd_tasks::{View, Work};

use super::quantity::{Draw, draws};
use super::terms::{Action, Law};
use crate::prelude::*;

/// Largest difference of torques of one law, of the largest.
const ALIKE: f64 = 1e-9;

/// A task's law, compared with the robot's controller and with torques in proportion, and what its actions are.
pub(super) fn actions(task: &dyn Task, system: &Arc<System>) -> Result<(Law, Vec<Action>)> {
    let (scene, mut work, mut rng) = (system.scene(task.scene())?, Work::new(system), stream(18, 0));
    let (robot, n) = (&system.robot, task.action_dim());
    let mut asked = |Draw { state, goal }: &Draw, action: &[f64]| {
        let mut torques = vec![0.0; robot.joint_count()];
        task.act(View { state, goal, scene: &scene }, action, &mut work, &mut torques);
        torques
    };
    let draws: Vec<(Draw, Vec<f64>)> =
        draws(task, system).into_iter().map(|draw| (draw, (0..n).map(|_| rng.random_range(-1.0..1.0)).collect())).collect();
    let alike = |a: &[f64], b: &[f64]| {
        let most = a.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
        a.iter().zip(b).all(|(x, y)| (x - y).abs() <= ALIKE * most)
    };
    let finite = |x: f64| Some(x).filter(|x| x.is_finite());
    // Column by column, what an action of 1 does alone.
    let alone: Vec<Vec<f64>> =
        (0..n).map(|k| asked(&draws[0].0, &(0..n).map(|i| f64::from(u8::from(i == k))).collect::<Vec<_>>())).collect();
    let torques = |action: &[f64]| -> Vec<f64> {
        (0..robot.joint_count()).map(|joint| action.iter().zip(&alone).map(|(a, column)| a * column[joint]).sum()).collect()
    };
    let joints: Vec<&Joint> = robot.joints().collect();
    if draws.iter().all(|(draw, action)| alike(&asked(draw, action), &torques(action)))
        && let Some(columns) = alone.iter().map(|column| single(column)).collect::<Option<Vec<_>>>()
    {
        let action = |(joint, scale): (usize, f64)| {
            let Joint { name, kind, effort, .. } = joints[joint];
            let unit = if *kind == JointKind::Prismatic { "N" } else { "N m" };
            Action { joint: name.clone(), unit: unit.into(), scale, effort: finite(*effort), ..Action::default() }
        };
        return Ok((Law::Torque, columns.into_iter().map(action).collect()));
    }
    let mut controller = Controller::new(system);
    let mut controlled = |(draw, action): &(Draw, Vec<f64>)| {
        let mut torques = vec![0.0; robot.joint_count()];
        controller.torques(&draw.state, action, &mut torques);
        alike(&asked(draw, action), &torques)
    };
    match system.spec.control {
        Some(law) if n == robot.joint_count() && draws.iter().all(&mut controlled) => {
            let action = |(joint, spec): (&&Joint, &nerd_sim::system::JointSpec)| Action {
                joint: joint.name.clone(),
                unit: if joint.kind == JointKind::Prismatic { "m" } else { "rad" }.into(),
                scale: law.scale,
                default: spec.default,
                kp: spec.kp,
                kd: spec.kd,
                torque: law.clamp.then(|| spec.gain.unwrap_or(spec.torque)),
                effort: finite(joint.effort),
            };
            let servo = law.servo && task.controlled();
            let action = joints.iter().zip(system.joint_specs()).map(action).collect();
            Ok((Law::Position { relative: law.relative, ahead: law.ahead && !servo, servo }, action))
        }
        _ => Ok((Law::Own, vec![Action::default(); n])),
    }
}

/// The joint that this acts at, if it is one alone, and how much.
fn single(torques: &[f64]) -> Option<(usize, f64)> {
    let mut acting = torques.iter().copied().enumerate().filter(|(_, tau)| *tau != 0.0);
    acting.next().filter(|_| acting.next().is_none())
}
