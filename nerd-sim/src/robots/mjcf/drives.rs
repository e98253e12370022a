//! Converts actuators to gains and efforts of joints, and joint equalities to joints that follow another.

use std::collections::HashMap;

use super::actuator::Actuator;
use super::element::Element;
use super::tree::{Follower, Motor, Tree};
use crate::internal::*;

/// Combined parameters of each joint's actuators; the effort is also limited by the joint's own force range.
pub(super) fn motors(tree: &Tree, notes: &mut Vec<String>) -> Result<HashMap<String, Motor>, UrdfError> {
    let mut found = HashMap::<String, Motor>::new();
    for (actuator, e) in &tree.model.actuators {
        let (joint, ratio) = lever(tree, actuator, e)?;
        let Some((_, own, body)) = tree.all_joints().find(|(name, ..)| **name == joint) else {
            return Err(
                e.refused(format!("it acts on `{}`, which is no hinge or slide of the file", joint.escape_debug()))
            );
        };
        let compiler = &tree.model.bodies[body].source.compiler;
        if e.number("inheritrange")?.is_some_and(|x| x > 0.0)
            && (actuator.joint.is_none() || own.limits(compiler).is_none())
        {
            return Err(
                e.refused(format!("inheritrange, and `{}` has no range; write ctrlrange", joint.escape_debug()))
            );
        }
        if actuator.lopsided(compiler) {
            notes.push(format!(
                "joint `{joint}`: its actuator is stronger one way; the larger of both is taken for both"
            ));
        }
        let square = (ratio * actuator.gear).powi(2);
        let [_, kp, kd] = actuator.gains();
        let effort = ratio.abs() * actuator.effort(compiler);
        let ratio = actuator.damping_ratio();
        let first = !found.contains_key(&joint);
        let sum = found.entry(joint).or_default();
        sum.effort = effort + if first { 0.0 } else { sum.effort };
        sum.kp += square * kp;
        sum.kd += if ratio.is_none() { square * kd } else { 0.0 };
        sum.ratios.extend(ratio.map(|ratio| [square * kp, ratio]));
        sum.armature += square * actuator.armature;
        sum.damping += square * actuator.damping;
    }
    for (name, joint, body) in tree.all_joints() {
        let most = joint.torque_limit(&tree.model.bodies[body].source.compiler);
        if most.is_finite() {
            let motor = found.entry(name.clone()).or_default();
            motor.effort = motor.effort.min(most);
        }
    }
    Ok(found)
}

/// The joint that an actuator drives, and the transmission ratio between them. For a fixed tendon, the ratio is summed
/// over its coupled joints.
fn lever(tree: &Tree, actuator: &Actuator, e: &Element) -> Result<(String, f64), UrdfError> {
    if let Some(joint) = &actuator.joint {
        return Ok((joint.clone(), 1.0));
    }
    let tendon = actuator.tendon.clone().unwrap_or_default();
    let parts = tree.model.tendons.get(&tendon);
    let parts = parts.ok_or_else(|| {
        e.refused(format!("there is no fixed tendon `{}`; others are not supported", tendon.escape_debug()))
    })?;
    let led = |(name, share): &(String, f64)| match tree.follow.get(name) {
        Some(f) => (f.leader.clone(), share * f.multiplier),
        None => (name.clone(), *share),
    };
    let led: Vec<_> = parts.iter().map(led).collect();
    match led.first() {
        Some((joint, _)) if led.iter().all(|(other, _)| other == joint) => {
            Ok((joint.clone(), led.iter().map(|(_, share)| share).sum()))
        }
        _ => Err(e.refused(format!(
            "tendon `{}` pulls joints that move by themselves, which is not supported",
            tendon.escape_debug()
        ))),
    }
}

/// For each coupled joint, the joint that it follows. Equalities of the file are relative to the joints' reference
/// positions.
pub(super) fn followers(tree: &Tree) -> Result<HashMap<String, Follower>, UrdfError> {
    let refs: HashMap<_, _> = tree.all_joints().map(|(name, joint, _)| (name.as_str(), joint.reference)).collect();
    let mut found = HashMap::<String, Follower>::new();
    for coupling in &tree.model.couplings {
        let e = &coupling.element;
        let Some(leader) = &coupling.leader else { return Err(e.refused("it fixes the joint; leave the joint out")) };
        let (Some(at), Some(leads)) = (refs.get(coupling.joint.as_str()), refs.get(leader.as_str())) else {
            return Err(e.refused("one of its two is no hinge or slide of the file"));
        };
        let [constant, multiplier, rest @ ..] = coupling.polynomial;
        if rest != [0.0; 3] {
            return Err(e.refused("a polynomial is not supported; a joint follows another in proportion"));
        }
        let offset = at + constant - multiplier * leads;
        if found.insert(coupling.joint.clone(), Follower { leader: leader.clone(), multiplier, offset }).is_some() {
            return Err(e.refused("the joint follows two others"));
        }
    }
    // Resolve chains of followers; more steps than followers indicate a cycle.
    let direct = found.clone();
    for (own, follower) in &mut found {
        for step in 0..=direct.len() {
            let Some(next) = direct.get(&follower.leader) else { break };
            if step == direct.len() {
                return Err(UrdfError::Refused(format!(
                    "joint `{}` follows itself by its equalities",
                    own.escape_debug()
                )));
            }
            follower.offset += follower.multiplier * next.offset;
            follower.multiplier *= next.multiplier;
            follower.leader.clone_from(&next.leader);
        }
    }
    Ok(found)
}
