//! Laws of the touches in a stage of an implicit substep, with their derivatives.

use nalgebra::DMatrix;

use super::super::kept::{Stage, Step};
use super::super::touch::{Contact, Touch};
use super::super::{find::above, press::turns, workspace::Workspace};
use super::contact_law::ContactLaw;
use super::law::{At, JointLaw};
use super::turn::TurnLaw;
use crate::prelude::*;

/// A force that acts in a stage, with the derivatives of its law.
#[allow(clippy::large_enum_variant)] // Most are contacts.
pub(super) enum Law {
    Contact(Contact, ContactLaw, Option<TurnLaw>),
    /// Limit or dry friction of a joint, the index of its w (none for dry friction), and its law.
    Joint(usize, Option<usize>, JointLaw),
    /// Drive of a joint, the index of its w, and its law.
    Drive(usize, usize, JointLaw),
}

/// System, scene and friction law of the frame.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) system: &'a System,
    pub(super) scene: &'a Scene,
    pub(super) friction: Friction,
}

impl Law {
    /// Subtracts `h` times the force's derivative with respect to the acceleration from the solve's transposed
    /// Jacobian.
    pub(super) fn resist(
        &self,
        robot: &Robot,
        data: &Data,
        h: f64,
        columns: &mut Vec<(usize, Vector3<f64>)>,
        matrix: &mut DMatrix<f64>,
    ) {
        match self {
            Law::Contact(contact, law, turn) => {
                columns.clear();
                above(robot, data, contact.link, &contact.x, columns);
                for (i, a) in columns.iter() {
                    let along = law.by_change.tr_mul(a) * h;
                    columns.iter().for_each(|(j, b)| matrix[(*j, *i)] -= along.dot(b));
                }
                let Some(turn) = turn else { return };
                for (i, a) in turns(robot, (&data.dof, &data.axis), contact.link) {
                    let along = turn.by_change.tr_mul(&a) * h;
                    turns(robot, (&data.dof, &data.axis), contact.link)
                        .for_each(|(j, b)| matrix[(j, i)] -= along.dot(&b));
                    if turn.then.is_none() {
                        let along = law.by_change.tr_mul(&contact.normal) * (turn.by_press.dot(&a) * h);
                        columns.iter().for_each(|(j, b)| matrix[(*j, i)] -= along.dot(b));
                    }
                }
            }
            Law::Joint(joint, _, law) | Law::Drive(joint, _, law) => {
                let k = robot.root_dofs() + joint;
                matrix[(k, k)] -= h * law.by_change;
            }
        }
    }
}

impl Workspace {
    /// Laws of the touches in a stage; needs `bias` at its middle velocity.
    pub(super) fn laws(
        &self,
        place: Place,
        step: &Step,
        stage: &Stage,
        (qdd, turn): (&[f64], &Vector3<f64>),
        quickened: &[Motion],
    ) -> Vec<Law> {
        let Place { system, scene, friction } = place;
        let robot = &system.robot;
        let h = step.h;
        let weight = |index: usize| self.touches.weights[index].unwrap_or(f64::INFINITY);
        let at = At { h, weight: f64::INFINITY, friction, first: stage.first, mean_theta: self.touches.mean_theta };
        let change = |joint: usize| h * qdd[robot.root_dofs() + joint];
        let law = |(n, touch): (usize, &Touch)| match touch {
            Touch::Contact(contact) => {
                let at = At { weight: weight(contact.index), ..at };
                let mut contact = contact.clone();
                if let Some(held) = stage.held.get(n) {
                    [contact.slip_offset, contact.turning.turn_offset] = *held;
                }
                contact.bend(&robot.contact_points[contact.point], &self.data, &(scene.gravity - turn), turn, h);
                let law = ContactLaw::of(&contact, &at, &contact.whole, &(quickened[contact.link].at(&contact.x) * h));
                let turn =
                    contact.turns().then(|| TurnLaw::of(&contact, &at, &law, &(quickened[contact.link].ang * h)));
                Law::Contact(contact, law, turn)
            }
            Touch::Limit(spring) => {
                let at = At { weight: weight(spring.index), ..at };
                let whole = robot.joints().nth(spring.joint).and_then(|j| j.limit).map(|l| [l.stiffness, l.damping]);
                Law::Joint(spring.joint, Some(spring.index), JointLaw::spring(spring, &at, whole, change(spring.joint)))
            }
            Touch::Drive { spring, .. } => {
                let at = At { weight: weight(spring.index), ..at };
                Law::Drive(spring.joint, spring.index, JointLaw::spring(spring, &at, None, change(spring.joint)))
            }
            Touch::Friction(dry) => Law::Joint(dry.joint, None, JointLaw::friction(dry, &at, change(dry.joint))),
        };
        step.touches
            .iter()
            .enumerate()
            .zip(&stage.idle)
            .filter(|(_, idle)| !**idle)
            .map(|(touch, _)| law(touch))
            .collect()
    }
}
