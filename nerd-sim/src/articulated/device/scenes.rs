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
    let same = held.scenes.len() == batch.len() && held.scenes.iter().zip(&batch.scenes).all(|(a, b)| Arc::ptr_eq(a, b));
    if !same {
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

/// Takes over the batch's scenes.
fn know(held: &mut Held, device: &Device, batch: &Batch, config: &ArticulatedConfig, reach: Reach) -> Result<(), StepError> {
    held.scenes.clear();
    let (mut records, mut of, mut last): (Vec<f64>, Vec<i32>, Option<&Arc<Scene>>) = (Vec::new(), Vec::new(), None);
    let mut count = 0;
    for scene in &batch.scenes {
        // Environments mostly share one.
        if !last.is_some_and(|known| Arc::ptr_eq(known, scene)) {
            records.extend(record(scene, &batch.system, config, reach).map_err(StepError::Refused)?);
            (last, count) = (Some(scene), count + 1);
        }
        of.push(count - 1);
    }
    held.records = device.upload(&records).map_err(failed)?;
    device.write(&held.scene_of, &of).map_err(failed)?;
    held.scenes.clone_from(&batch.scenes);
    Ok(())
}
