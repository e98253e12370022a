//! Uploads of a batch: states, torques, drives and scenes.

use nerd_cuda::Device;

use super::program::{Reach, packed};
use super::records::records;
use crate::prelude::*;
use crate::solver::device::{Held, failed};

/// Uploads a batch and its torques; uploads scenes and robots only if changed.
pub(super) fn take(
    held: &mut Held,
    device: &Device,
    batch: &Batch,
    reach: Reach,
    torques: &[f64],
) -> Result<(), StepError> {
    if !(same(&held.scenes, &batch.scenes) && same(&held.systems, &batch.systems)) {
        know(held, device, batch, reach)?;
    }
    if held.torques.len < torques.len() {
        held.torques = device.zeros(torques.len()).map_err(failed)?;
    }
    held.watched = !batch.forces.is_empty();
    device.write(&held.states, &batch.states).map_err(failed)?;
    device.write(&held.torques, torques).map_err(failed)?;
    device.write(&held.drives, &packed(&batch.drives)).map_err(failed)
}

fn same<T>(known: &[Arc<T>], now: &[Arc<T>]) -> bool {
    known.len() == now.len() && known.iter().zip(now).all(|(a, b)| Arc::ptr_eq(a, b))
}

/// Uploads the batch's scenes, with the parameters of the robots in them.
fn know(held: &mut Held, device: &Device, batch: &Batch, reach: Reach) -> Result<(), StepError> {
    held.scenes.clear();
    let (records, of) = records(batch, reach).map_err(StepError::Refused)?;
    held.records = device.upload(&records).map_err(failed)?;
    device.write(&held.scene_of, &of).map_err(failed)?;
    held.scenes.clone_from(&batch.scenes);
    held.systems.clone_from(&batch.systems);
    Ok(())
}
