//! A batch in a device's memory.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;
use nerd_cuda::{Buffer, Device, DeviceError};
use rayon::prelude::*;

use super::super::ArticulatedConfig;
use super::program::{Reach, packed, record};
use super::roll::failed;
use crate::batch::Batch;
use crate::scene::Scene;
use crate::solver::StepError;

/// Memory for so many environments, and the scenes that the device knows.
pub struct Held {
    /// Environments.
    pub n: usize,
    /// `[env][q, qd]`.
    pub states: Buffer<f64>,
    /// Five numbers a joint, where there are drives.
    pub drives: Buffer<f64>,
    /// Of each environment, or `[frame]` of each.
    pub torques: Buffer<f64>,
    /// Those of the joints that torques act on, where they are few.
    few: Buffer<f64>,
    /// Scenes, one after the other, and which of them is whose.
    pub records: Buffer<f64>,
    /// See `records`.
    pub scene_of: Buffer<i32>,
    /// Why an environment went no further, or 0.
    pub faults: Buffer<i32>,
    /// Frames that went well.
    pub done: Buffer<u32>,
    forces: Buffer<f64>,
    told: bool,
    scenes: Vec<Arc<Scene>>,
}

impl Held {
    /// Memory for a batch.
    ///
    /// # Errors
    /// If there is not enough.
    pub fn new(device: &Device, batch: &Batch) -> Result<Self, DeviceError> {
        let (n, robot) = (batch.len(), &batch.system.robot);
        Ok(Self {
            n,
            states: device.zeros(n * robot.state_dim())?,
            drives: device.zeros(5 * batch.drives.len())?,
            torques: device.zeros(n * robot.joint_count())?,
            few: device.zeros(0)?,
            records: device.zeros(0)?,
            scene_of: device.zeros(n)?,
            faults: device.zeros(n)?,
            done: device.zeros(n)?,
            forces: device.zeros(3 * n * robot.contact_points.len())?,
            told: false,
            scenes: Vec::new(),
        })
    }

    /// Where contact forces go; 0 if nobody asks.
    pub fn forces(&self) -> u64 {
        if self.told { self.forces.ptr } else { 0 }
    }

    /// Takes over a batch and its torques.
    pub(super) fn take(
        &mut self,
        device: &Device,
        batch: &Batch,
        config: &ArticulatedConfig,
        reach: Reach,
        torques: &[f64],
    ) -> Result<(), StepError> {
        let same = self.scenes.len() == batch.len() && self.scenes.iter().zip(&batch.scenes).all(|(a, b)| Arc::ptr_eq(a, b));
        if !same {
            self.know(device, batch, config, reach)?;
        }
        self.told = !batch.forces.is_empty();
        device.write(&self.states, &batch.states).map_err(failed)?;
        self.push(device, torques, batch.system.robot.joint_count()).map_err(failed)?;
        device.write(&self.drives, &packed(&batch.drives)).map_err(failed)
    }

    /// Takes over torques, rows of so many joints.
    fn push(&mut self, device: &Device, torques: &[f64], joints: usize) -> Result<(), DeviceError> {
        if self.torques.len < torques.len() {
            self.torques = device.zeros(torques.len())?;
        }
        let acting = acting(torques, joints);
        if 2 * acting.len() > joints {
            return device.write(&self.torques, torques);
        }
        // A cable has a gripper's six joints and no motor behind them: nearly all of its torques are 0, and the way to a device is long.
        let few = columns(torques, joints, acting.clone());
        if self.few.len < few.len() {
            self.few = device.zeros(few.len())?;
        }
        device.write(&self.few, &few)?;
        device.spread(&self.few, &self.torques, torques.len() / joints.max(1), [acting.start, acting.len(), joints])
    }

    /// Takes over the batch's scenes.
    fn know(&mut self, device: &Device, batch: &Batch, config: &ArticulatedConfig, reach: Reach) -> Result<(), StepError> {
        self.scenes.clear();
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
        self.records = device.upload(&records).map_err(failed)?;
        device.write(&self.scene_of, &of).map_err(failed)?;
        self.scenes.clone_from(&batch.scenes);
        Ok(())
    }

    /// States and forces after the frames; each environment's fault and the frames that it made.
    pub(super) fn give(&self, device: &Device, batch: &mut Batch, next: &mut Vec<f64>) -> Result<Vec<(i32, u32)>, DeviceError> {
        next.resize(batch.states.len(), 0.0);
        device.read(&self.states, next)?;
        let (mut wrong, mut went) = (vec![0i32; self.n], vec![0u32; self.n]);
        device.read(&self.faults, &mut wrong)?;
        device.read(&self.done, &mut went)?;
        if self.told {
            let mut forces = vec![0.0; 3 * batch.forces.len()];
            device.read(&self.forces, &mut forces)?;
            batch.forces.iter_mut().zip(forces.as_chunks::<3>().0).for_each(|(f, x)| *f = Vector3::from(*x));
        }
        Ok(wrong.into_iter().zip(went).collect())
    }
}

/// Rows that a thread looks at in one go.
const ROWS: usize = 1024;

/// The columns outside of which all entries are 0, of rows of so many.
fn acting(rows: &[f64], width: usize) -> Range<usize> {
    let none = (width, 0);
    let both = |a: (usize, usize), b: (usize, usize)| (a.0.min(b.0), a.1.max(b.1));
    let of = |row: &[f64]| {
        let first = row.iter().position(|x| *x != 0.0)?;
        Some((first, row.iter().rposition(|x| *x != 0.0)? + 1))
    };
    let some = |rows: &[f64]| rows.chunks(width).filter_map(of).fold(none, both);
    let (first, end) = if width == 0 { none } else { rows.par_chunks(ROWS * width).map(some).reduce(|| none, both) };
    first.min(end)..end
}

/// These columns alone.
fn columns(rows: &[f64], width: usize, range: Range<usize>) -> Vec<f64> {
    let few = range.len();
    let mut packed = vec![0.0; rows.len() / width.max(1) * few];
    if few > 0 {
        let parts = packed.par_chunks_mut(ROWS * few).zip(rows.par_chunks(ROWS * width));
        parts.for_each(|(to, from)| {
            to.chunks_mut(few).zip(from.chunks(width)).for_each(|(to, from)| to.copy_from_slice(&from[range.clone()]));
        });
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_act_are_found_and_packed() {
        let width = 7;
        let mut rows = vec![0.0; 3000 * width];
        assert_eq!((acting(&rows, width), acting(&[], width), acting(&[], 0)), (0..0, 0..0, 0..0), "nothing acts");
        (rows[2500 * width + 4], rows[10 * width + 2]) = (f64::NAN, -1.0);
        assert_eq!(acting(&rows, width), 2..5, "what is no number acts");
        rows[2500 * width + 4] = 3.0;
        let packed = columns(&rows, width, 2..5);
        assert_eq!((packed.len(), packed[30], packed[7502]), (9000, -1.0, 3.0));
        assert_eq!(packed.iter().filter(|x| **x != 0.0).count(), 2);
    }
}
