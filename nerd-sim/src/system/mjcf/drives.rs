//! Actuators as gains and efforts of joints, and equalities of joints as joints that follow.

use std::collections::HashMap;

use mjcf_rs::Model;
use mjcf_rs::{equality::Equality, extras::ActuatorKind};

use super::text::Source;
use crate::internal::*;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motor {
    /// Stiffness and damping of a position or velocity law.
    pub kp: f64,
    pub kd: f64,
    /// Largest torque (N m) or force (N); infinite where nothing bounds it.
    pub effort: f64,
}

/// By joint, what its actuators do together.
pub(super) fn motors(model: &Model, source: &Source, notes: &mut Vec<String>) -> Result<HashMap<String, Motor>, UrdfError> {
    let mut found = HashMap::<String, Motor>::new();
    for actuator in &model.actuators {
        let kind = match actuator.kind {
            ActuatorKind::Motor => "motor",
            ActuatorKind::Position => "position",
            ActuatorKind::Velocity => "velocity",
            _ => "general",
        };
        let name = actuator.name.as_ref().or(actuator.joint.as_ref()).map_or("", |name| name);
        let wrong = |reason: &str| source.refused(kind, name, reason);
        let Some(joint) = &actuator.joint else {
            return Err(wrong("it acts on no joint; motor, position, velocity and general on joints are supported"));
        };
        let compiler = &model.compiler;
        let largest = |range: Option<[f64; 2]>, limited: mjcf_rs::Tristate| {
            let range = range.filter(|range| limited.resolve(compiler.autolimits, range[0] < range[1]));
            range.map_or(f64::INFINITY, |[low, high]| low.abs().max(high.abs()))
        };
        let lopsided = |range: Option<[f64; 2]>| range.is_some_and(|[low, high]| low != -high);
        let gear = actuator.gear[0];
        let prm = |all: &[f64], k: usize, other: f64| all.get(k).copied().unwrap_or(other);
        let mut gain = 1.0;
        let [kp, kd] = match kind {
            "motor" => [0.0, 0.0],
            "position" => [actuator.kp.unwrap_or(1.0), actuator.kv.unwrap_or(0.0)],
            "velocity" => [0.0, actuator.kv.unwrap_or(1.0)],
            _ => {
                gain = prm(&actuator.gainprm, 0, 1.0);
                let affine = actuator.bias_type.as_deref() == Some("affine");
                let law = [0, 1, 2].map(|k| if affine { prm(&actuator.biasprm, k, 0.0) } else { 0.0 });
                if gain != 0.0 && law[0] != 0.0 {
                    return Err(wrong("a constant part of its bias is not supported"));
                }
                [-law[1], -law[2]]
            }
        };
        if !(kp >= 0.0 && kd >= 0.0) {
            return Err(wrong("it has a negative gain"));
        }
        let plain = kp == 0.0 && kd == 0.0;
        let asked = if plain { gain.abs() * largest(actuator.ctrl_range, actuator.ctrl_limited) } else { f64::INFINITY };
        let effort = gear.abs() * asked.min(largest(actuator.force_range, actuator.force_limited));
        if lopsided(actuator.force_range) || plain && lopsided(actuator.ctrl_range) {
            notes.push(format!("joint `{joint}`: its actuator is stronger one way; the larger of both is taken for both"));
        }
        let sum = found.entry(joint.clone()).or_default();
        sum.kp += gear * gear * kp;
        sum.kd += gear * gear * kd;
        sum.effort += if effort.is_nan() { 0.0 } else { effort };
    }
    Ok(found)
}

/// A joint that follows another: `position = multiplier q + offset`.
#[derive(Clone, Debug)]
pub(super) struct Follower {
    pub leader: String,
    pub multiplier: f64,
    pub offset: f64,
}

/// By joint, what it follows; `refs` are the joints' positions in the file's own pose, from which equalities count.
pub(super) fn followers(model: &Model, source: &Source, refs: &HashMap<String, f64>) -> Result<HashMap<String, Follower>, UrdfError> {
    let mut found = HashMap::new();
    for equality in &model.equality {
        let Equality::Joint(equality) = equality else { continue };
        if !equality.common.active {
            continue;
        }
        let own = &equality.joint1;
        let wrong = |reason: &str| source.refused("joint", own, format!("equality: {reason}"));
        let Some(leader) = &equality.joint2 else { return Err(wrong("it fixes the joint; leave the joint out")) };
        let (Some(at), Some(leads)) = (refs.get(own), refs.get(leader)) else {
            return Err(wrong("one of its two is no hinge or slide of the file"));
        };
        let [constant, multiplier, rest @ ..] = equality.polycoef;
        if rest != [0.0; 3] {
            return Err(wrong("a polynomial is not supported; a joint follows another in proportion"));
        }
        let offset = at + constant - multiplier * leads;
        if found.insert(own.clone(), Follower { leader: leader.clone(), multiplier, offset }).is_some() {
            return Err(wrong("the joint follows two others"));
        }
    }
    match found.iter().find(|(_, follower)| found.contains_key(&follower.leader)) {
        Some((own, follower)) => {
            Err(source.refused("joint", own, format!("it follows `{}`, which follows another; name that", follower.leader)))
        }
        None => Ok(found),
    }
}
