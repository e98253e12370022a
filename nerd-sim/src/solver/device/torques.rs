//! Torques copied to a device. For a robot driven at few of its joints, such as a cable, only those columns are copied; the device fills in
//! zeros.

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

/// How many leading columns of `[row][joints]` hold all that is not 0; `None` if a number is not finite.
pub(crate) fn acting(torques: &[f64], joints: usize) -> Option<usize> {
    let seen = |rows: &[f64]| {
        // For each column, over all rows and without a branch: the bits that are set, and a sum that stays 0 unless a number is not finite.
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

/// Writes the leading columns of `[row][joints]` to `packed`, where they pay: packing costs a pass over them, so half of all have to stay
/// away.
fn pack(torques: &[f64], columns: usize, joints: usize, packed: &mut Vec<f64>) -> bool {
    if torques.is_empty() || 2 * columns > joints {
        return false;
    }
    packed.resize(torques.len() / joints * columns, 0.0);
    let parts = packed.par_chunks_mut((ROWS * columns).max(1)).zip(torques.par_chunks(ROWS * joints));
    parts.for_each(|(packed, torques)| {
        let rows = packed.chunks_exact_mut(columns.max(1)).zip(torques.chunks_exact(joints));
        rows.for_each(|(packed, torques)| packed.copy_from_slice(&torques[..columns]));
    });
    true
}

pub(crate) struct Sender {
    /// Of its own, since kernels are a device's.
    device: Device,
    packed: Vec<f64>,
    sent: Buffer<f64>,
}

impl Sender {
    pub(crate) fn new() -> Result<Self, DeviceError> {
        let device = Device::open(SPREAD, &["spread"])?;
        Ok(Self { sent: device.zeros(0)?, packed: Vec::new(), device })
    }

    /// Writes `[row][joints]`, of which so many leading columns act, to `all`, after the work of `device` before it.
    pub(crate) fn send(
        &mut self,
        device: &Device,
        all: &Buffer<f64>,
        torques: &[f64],
        columns: usize,
        joints: usize,
    ) -> Result<(), DeviceError> {
        if !pack(torques, columns, joints, &mut self.packed) {
            return device.write(all, torques);
        }
        if self.sent.len < self.packed.len() {
            self.sent = self.device.zeros(self.packed.len())?;
        }
        device.wait()?;
        self.device.write(&self.sent, &self.packed)?;
        let args = [Ptr(self.sent.ptr), Ptr(all.ptr), Int(joints), Int(columns)];
        self.device.launch("spread", (torques.len() / joints, 1), (64, 1), 0, &args)?;
        self.device.wait()
    }
}

#[cfg(test)]
mod tests {
    use super::{ROWS, acting, pack};

    #[test]
    fn columns_that_act_lead_to_the_last_that_is_not_zero() {
        let joints = 7;
        let mut torques = vec![0.0; 3 * ROWS * joints];
        let last = torques.len() - joints;
        assert_eq!(acting(&torques, joints), Some(0), "of zeros");
        for (at, x, columns) in [
            (5, -0.0, Some(0)),
            (last + 3, -1e-300, Some(4)),
            (0, 1.0, Some(4)),
            (last - 1, f64::NAN, None),
            (last - 1, f64::INFINITY, None),
            (last - 1, f64::NEG_INFINITY, None),
        ] {
            torques[at] = x;
            assert_eq!(acting(&torques, joints), columns, "after {x} at {at}");
        }
        assert_eq!((acting(&[], joints), acting(&[], 0)), (Some(0), Some(0)), "of nothing");
    }

    #[test]
    fn packed_rows_are_the_leading_columns_of_all_rows() {
        let (joints, mut packed) = (7, Vec::new());
        for rows in [1, ROWS, 2 * ROWS + 3] {
            let torques: Vec<f64> = (0..rows * joints).map(|k| k as f64).collect();
            for columns in 0..=3 {
                assert!(pack(&torques, columns, joints, &mut packed), "{columns} of {joints}");
                let wanted: Vec<f64> = torques.chunks_exact(joints).flat_map(|row| row[..columns].iter().copied()).collect();
                assert_eq!(packed, wanted, "{columns} columns of {rows} rows");
            }
            assert!(!pack(&torques, 4, joints, &mut packed), "more than half of the columns are packed");
        }
        assert!(!pack(&[], 0, joints, &mut packed), "of no rows");
        assert!(!pack(&[], 0, 0, &mut packed), "of a robot without joints");
    }
}
