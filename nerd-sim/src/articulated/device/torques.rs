//! Torques on their way to a device. Of a robot that is driven at few of its joints, a cable by its gripper, only those columns travel; the
//! device puts zeros behind them.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError};
use rayon::prelude::*;

/// `[row][columns]` to `[row][joints]`, a block a row.
const SPREAD: &str = "extern \"C\" __global__ void spread(const double* sent, double* all, int joints, int columns) {
    for (int k = threadIdx.x; k < joints; k += blockDim.x)
        all[(long long)blockIdx.x * joints + k] = k < columns ? sent[(long long)blockIdx.x * columns + k] : 0;
}";

/// Rows that a thread looks at together.
const ROWS: usize = 256;

/// How many leading columns of `[row][joints]` hold all that is not 0; nothing if a number is not finite.
pub(super) fn acting(torques: &[f64], joints: usize) -> Option<usize> {
    let seen = |rows: &[f64]| {
        // Both grow from column to column without a branch: a product with 0 is 0, or no number.
        let (mut bits, mut sound) = (vec![0u64; joints], vec![0.0; joints]);
        for row in rows.chunks_exact(joints) {
            bits.iter_mut().zip(row).for_each(|(bits, x)| *bits |= x.to_bits() << 1);
            sound.iter_mut().zip(row).for_each(|(sound, x)| *sound += x * 0.0);
        }
        let columns = bits.iter().rposition(|b| *b != 0).map_or(0, |k| k + 1);
        sound.iter().all(|s| *s == 0.0).then_some(columns)
    };
    torques.par_chunks((ROWS * joints).max(1)).map(seen).try_reduce(|| 0, |a, b| Some(a.max(b)))
}

/// What sends torques.
pub(super) struct Sender {
    /// Of its own, since kernels are a device's.
    device: Device,
    packed: Vec<f64>,
    sent: Buffer<f64>,
}

impl Sender {
    pub(super) fn new() -> Result<Self, DeviceError> {
        let device = Device::open(nerd_cuda::ordinal(), SPREAD, &["spread"])?;
        Ok(Self { sent: device.zeros(0)?, packed: Vec::new(), device })
    }

    /// Writes `[row][joints]`, of which so many columns act, to `all`, after the work of `device` before it.
    pub(super) fn send(
        &mut self,
        device: &Device,
        all: &Buffer<f64>,
        torques: &[f64],
        columns: usize,
        joints: usize,
    ) -> Result<(), DeviceError> {
        // Packing costs a pass over the columns that act, so half of them have to stay away for it to pay.
        if 2 * columns > joints {
            return device.write(all, torques);
        }
        let rows = torques.len() / joints.max(1);
        self.packed.resize(rows * columns, 0.0);
        let parts = self.packed.par_chunks_mut((ROWS * columns).max(1)).zip(torques.par_chunks(ROWS * joints));
        parts.for_each(|(packed, torques)| {
            packed.chunks_exact_mut(columns).zip(torques.chunks_exact(joints)).for_each(|(p, t)| p.copy_from_slice(&t[..columns]));
        });
        if self.sent.len < self.packed.len() {
            self.sent = self.device.zeros(self.packed.len())?;
        }
        device.wait()?;
        self.device.write(&self.sent, &self.packed)?;
        let args = [Ptr(self.sent.ptr), Ptr(all.ptr), Int(joints), Int(columns)];
        self.device.launch("spread", (rows, 1), (64, 1), 0, &args)?;
        self.device.wait()
    }
}

#[cfg(test)]
mod tests {
    use super::acting;

    #[test]
    fn columns_that_act_lead_to_the_last_that_is_not_zero() {
        let joints = 7;
        let mut torques = vec![0.0; 3 * super::ROWS * joints];
        assert_eq!(acting(&torques, joints), Some(0), "of zeros");
        torques[5] = -0.0;
        assert_eq!(acting(&torques, joints), Some(0), "of a zero with a sign");
        let last = torques.len() - joints;
        torques[last + 3] = -1e-300;
        assert_eq!(acting(&torques, joints), Some(4), "of one number in the last row");
        torques[0] = 1.0;
        assert_eq!(acting(&torques, joints), Some(4), "of two");
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            torques[last - 1] = bad;
            assert_eq!(acting(&torques, joints), None, "{bad}");
        }
        assert_eq!((acting(&[], joints), acting(&[], 0)), (Some(0), Some(0)), "of nothing");
    }
}
