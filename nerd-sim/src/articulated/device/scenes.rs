//! A batch's states, torques, drives and scenes, laid out for a device.

use nerd_cuda::Device;

use super::program::{Reach, packed, record};
use crate::prelude::*;
use crate::solver::device::{Held, failed};

/// Takes over a batch and its torques, of which so many columns act.
pub(super) fn take(
    held: &mut Held,
    device: &Device,
    batch: &Batch,
    config: &ArticulatedConfig,
    reach: Reach,
    (torques, columns): (&[f64], usize),
) -> Result<(), StepError> {
    if !(same(&held.scenes, &batch.scenes) && same(&held.systems, &batch.systems)) {
        know(held, device, batch, config, reach)?;
    }
    if held.torques.len < torques.len() {
        held.torques = device.zeros(torques.len()).map_err(failed)?;
    }
    held.watched = !batch.forces.is_empty();
    device.write(&held.states, &batch.states).map_err(failed)?;
    held.sender.send(device, &held.torques, torques, columns, batch.system.robot.joint_count()).map_err(failed)?;
    device.write(&held.drives, &packed(&batch.drives)).map_err(failed)
}

fn same<T>(known: &[Arc<T>], now: &[Arc<T>]) -> bool {
    known.len() == now.len() && known.iter().zip(now).all(|(a, b)| Arc::ptr_eq(a, b))
}

/// Takes over the batch's scenes and what robots in them have of their own.
fn know(held: &mut Held, device: &Device, batch: &Batch, config: &ArticulatedConfig, reach: Reach) -> Result<(), StepError> {
    held.scenes.clear();
    let (mut records, mut of, mut last): (Vec<f64>, Vec<i32>, Option<&Arc<Scene>>) = (Vec::new(), Vec::new(), None);
    let mut count = 0;
    for (env, scene) in batch.scenes.iter().enumerate() {
        let own = batch.of(env);
        if own.spec.vary != batch.system.spec.vary || own.spec.vary.is_none() && !batch.systems.is_empty() {
            return Err(StepError::Refused("on a device a batch's [vary] tells how its robots differ: draw them by it".into()));
        }
        // Environments mostly share one.
        if !batch.systems.is_empty() || !last.is_some_and(|known| Arc::ptr_eq(known, scene)) {
            records.extend(record(scene, own, config, reach).map_err(StepError::Refused)?);
            (last, count) = (Some(scene), count + 1);
        }
        of.push(count - 1);
    }
    held.records = device.upload(&records).map_err(failed)?;
    device.write(&held.scene_of, &of).map_err(failed)?;
    held.scenes.clone_from(&batch.scenes);
    held.systems.clone_from(&batch.systems);
    Ok(())
}
