//! The loss, and sums over rows. A sum goes through partial sums of a fixed number of blocks, so its order is fixed.

use nerd_cuda::Arg::{Float, Int, Long, Ptr};
use nerd_cuda::DeviceError;

use super::network::{Network, SUMS};

/// Most blocks of a loss, each of which writes a partial sum.
const LOSS_BLOCKS: usize = 264;
/// Most rows of partial sums in [`Network::sum_rows`].
const CHUNKS: usize = 256;

impl Network {
    /// Of the first `n` tokens: writes the sum of squared errors after the gradient vector at `g`, and the gradient of the loss, a mean over
    /// `all` tokens ([`crate::learner::LearnerConfig::huber`]), over the targets.
    pub fn loss(&self, n: usize, all: usize, huber: Option<f32>, g: u64) -> Result<(), DeviceError> {
        let (outputs, partial) = (self.plan.outputs(), Ptr(self.partial_sums.ptr));
        let [scale, bend] = [2.0 / (all * outputs) as f32, huber.map_or(0.0, |d| (d * d).recip())].map(Float);
        let blocks = (n * outputs).div_ceil(256).min(LOSS_BLOCKS);
        let args = [Ptr(self.predictions().ptr), Ptr(self.targets.ptr), partial, Long((n * outputs) as u64), scale, bend];
        self.device.launch("loss", (blocks, 1), (256, 1), 0, &args)?;
        self.column_sum(self.partial_sums.ptr, blocks, 1, g + 4 * self.plan.parameters() as u64)
    }

    /// Sums a gradient at `dy`, of `rows` windows of tokens of `width` columns: over windows to that of positions, over all tokens to that of
    /// a bias.
    pub fn sum_rows(&self, dy: u64, rows: usize, width: usize, bias: Option<u64>, positions: Option<u64>) -> Result<(), DeviceError> {
        let tokens = self.plan.tokens;
        let (rows, columns) = if positions.is_some() { (rows, tokens * width) } else { (rows * tokens, width) };
        let chunks = rows.min(SUMS / columns).clamp(1, CHUNKS);
        let args = [Ptr(dy), Int(rows), Int(columns), Ptr(self.partial_sums.ptr)];
        self.device.launch("row_partial", (columns.div_ceil(128), chunks), (128, 1), 0, &args)?;
        if let Some(sums) = positions.or(bias) {
            self.column_sum(self.partial_sums.ptr, chunks, columns, sums)?;
        }
        // A bias is added at every position.
        if let (Some(positions), Some(bias)) = (positions, bias) { self.column_sum(positions, tokens, width, bias) } else { Ok(()) }
    }

    fn column_sum(&self, src: u64, rows: usize, width: usize, out: u64) -> Result<(), DeviceError> {
        self.device.launch("column_sum", (width.div_ceil(32), 1), (32, 8), 0, &[Ptr(src), Int(rows), Int(width), Ptr(out)])
    }
}
