//! Finds, in the task's recorded formulas, how actions become torques.

use nerd_tasks::formula::{Forms, Tape, Traced};

use super::terms::{Action, Law};
use crate::prelude::*;

/// Identifies a task's law from actions to torques. Known laws are torques proportional to single actions, and the
/// robot's controller.
pub(super) fn actions(task: &dyn Task, system: &System) -> (Law, Vec<Action>) {
    let tape = Tape::default();
    let n = task.action_dim();
    let joints = system.robot.joint_count();
    let sight = task.sight(&tape, system);
    let action = sight.action(n);
    let (mut torques, mut own) = (vec![Traced::from(0.0); joints], vec![Traced::from(0.0); joints]);
    task.act(&sight, &action, &mut torques);
    let controller = system.spec.control.filter(|_| n == joints);
    if controller.is_some() {
        sight.controlled(&action, &mut own);
    }
    let forms = Forms::of(&tape, system);
    if let Some(actions) = direct(&forms, &torques, &action, system) {
        return (Law::Torque, actions);
    }
    let same = |(tau, own): (&Traced, &Traced)| forms.linear(*tau, &[*own]) == Some((vec![1.0], 0.0));
    match controller.filter(|_| torques.iter().zip(&own).all(same)) {
        Some(law) => {
            let action = |(joint, spec): (&Joint, &nerd_sim::system::JointSpec)| Action {
                joint: joint.name.clone(),
                unit: if joint.kind == JointKind::Prismatic { "m" } else { "rad" }.into(),
                scale: law.scale,
                default_q: spec.default_q,
                kp: spec.kp,
                kd: spec.kd,
                torque_limit: law.clamp.then(|| spec.gain.unwrap_or(spec.torque)),
                effort: finite(joint.effort),
            };
            let servo = law.servo && task.controlled();
            let action = system.robot.joints().zip(system.joint_specs()).map(action).collect();
            (Law::Position { relative: law.relative, stable_pd: law.stable_pd && !servo, servo }, action)
        }
        None => (Law::Own, vec![Action::default(); n]),
    }
}

/// Describes the actions, if torques are proportional to actions and each action acts on a single joint.
fn direct(forms: &Forms, torques: &[Traced], action: &[Traced], system: &System) -> Option<Vec<Action>> {
    let rows: Vec<(Vec<f64>, f64)> = torques.iter().map(|tau| forms.linear(*tau, action)).collect::<Option<_>>()?;
    if rows.iter().any(|(_, offset)| *offset != 0.0) {
        return None;
    }
    let one = |k: usize| {
        let mut acting = system.robot.joints().zip(&rows).filter(|(_, (scales, _))| scales[k] != 0.0);
        let (Joint { name, kind, effort, .. }, (scales, _)) = acting.next().filter(|_| acting.next().is_none())?;
        let unit = if *kind == JointKind::Prismatic { "N" } else { "N m" };
        Some(Action {
            joint: name.clone(),
            unit: unit.into(),
            scale: scales[k],
            effort: finite(*effort),
            ..Action::default()
        })
    };
    (0..action.len()).map(one).collect()
}

fn finite(x: f64) -> Option<f64> {
    Some(x).filter(|x| x.is_finite())
}
