//! Calibrates `articulated` to each robot of a family separately, from the frames that models see of the robot.

use nerd_sim::calibrate::{CalibrateError, Engine, FitConfig, Parameter, Subject, Trial};
use nerd_sim::rig::{LATEST, Motors};
use nerd_train::evaluate::Pieces;
use rayon::prelude::*;

use crate::prelude::*;

/// Frames of a fitted rollout; longer rollouts diverge while the parameters are still wrong.
const LENGTH: usize = 30;

/// Returns `pieces` with each robot calibrated to the frames seen of it; `None` if no frame is seen. Fits masses,
/// centres of mass, joint damping and friction, torque factors, sensor zeros and torque delay.
pub fn calibrated(pieces: &Pieces, evaluations: usize) -> Result<Option<Pieces>> {
    if pieces.before == 0 {
        return Ok(None);
    }
    let parameters = parameters(&pieces.system)?;
    let described = pieces.described();
    let fitted = |k: usize| -> Result<Arc<System>, CalibrateError> {
        let system = pieces.system.clone();
        let config = ArticulatedConfig::accurate(&pieces.system);
        let subject = Subject {
            scene: described.all.scenes[k].clone(),
            engine: Engine::Articulated(config),
            lag: 0.0,
            delay: 0.0,
            zeros: vec![0.0; system.robot.joint_count()],
            strength: vec![1.0; system.robot.joint_count()],
            system,
        };
        let config = FitConfig { evaluations, ..FitConfig::default() };
        let fit = subject.fit(&parameters, &trials(pieces, k), config, &mut |_, _| ())?;
        let own = subject.with(&parameters, &fit.values)?;
        let mut known = (*own.system).clone();
        known.motors = Motors { delay: own.delay, zeros: own.zeros, strength: own.strength, ..Motors::default() };
        Ok(Arc::new(known))
    };
    let systems = (0..pieces.count()).into_par_iter().map(fitted).collect::<Result<_, _>>()?;
    let mut known = described;
    known.all.systems = systems;
    Ok(Some(known))
}

/// Lists the parameters to fit, of the links, joints and motors.
fn parameters(system: &System) -> Result<Vec<Parameter>, CalibrateError> {
    let links = system.robot.links.iter().filter(|link| link.inertia.mass > 0.0);
    let links = links.flat_map(|link| ["mass", "com.x", "com.y", "com.z"].map(|what| format!("{what}:{}", link.name)));
    let brakes = system
        .robot
        .joints()
        .flat_map(|joint| ["joint-damping", "joint-friction", "strength"].map(|what| format!("{what}:{}", joint.name)));
    let names = links.chain(brakes).collect_vec();
    let named = names.iter().map(|name| Parameter::named(system, name)).collect::<Result<Vec<_>, _>>()?;
    let mut driven = Parameter::driven(system)?;
    // Sets the delay's upper bound to the largest delay that a family may have.
    driven.iter_mut().filter(|p| p.name == "delay").for_each(|p| p.high = LATEST);
    Ok([named, driven].concat())
}

/// Cuts the frames seen of the k-th robot into rollouts.
fn trials(pieces: &Pieces, k: usize) -> Vec<Trial> {
    let nq = pieces.system.robot.nq();
    let state = |frame: usize| pieces.all.state(k, frame);
    let torques = |frame: usize| pieces.all.torques(k, frame).to_vec();
    let trial = |first: usize| {
        let end = pieces.before.min(first + LENGTH);
        Trial {
            id: k as u64,
            first,
            start: state(first).to_vec(),
            measured: (first..=end).map(|frame| state(frame)[..nq].to_vec()).collect(),
            torques: (first..end).map(torques).collect(),
            earlier: [1, 2].map(|back| torques(first.saturating_sub(back))),
        }
    };
    (0..pieces.before).step_by(LENGTH).map(trial).collect()
}
