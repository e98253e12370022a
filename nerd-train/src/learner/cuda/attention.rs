//! Attention on the GPU: shape, constants and launches of its kernels.

use super::*;

/// `SHARED`: shared memory of a block (bytes) without opt-in; two blocks should fit in it. `ASKED`: shared memory with
/// opt-in, from compute capability 8 on.
const SHARED: usize = 48 << 10;
const ASKED: usize = 99 << 10;
/// Most tokens of a sequence: a block has one thread per token.
const TOKENS: usize = 128;

/// Shape of all attentions of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Attention {
    pub width: usize,
    pub heads: usize,
    /// Largest number of keys per query.
    pub seen: usize,
    /// Whether attention is banded, with rotary positions.
    rotary: bool,
    tokens: usize,
    group: usize,
}

impl Attention {
    pub fn new(width: usize, heads: usize, band: Option<usize>, tokens: usize) -> LearnResult<Self> {
        let mut shape = Self { width, heads, seen: band.unwrap_or(tokens), rotary: band.is_some(), tokens, group: 1 };
        if !width.is_multiple_of(4 * heads) || tokens > TOKENS || shape.seen > 32 {
            mismatch!(
                "attention on the device has windows of 32 tokens at most, sequences of {TOKENS}, and heads of 4, 8, 12 .. columns: {shape:?}"
            );
        }
        let fits = |group: &usize| {
            let shape = Self { group: *group, ..shape };
            heads.is_multiple_of(*group) && group * tokens <= TOKENS && shape.shared().1 <= SHARED / 2
        };
        shape.group = (1..=heads).rev().find(fits).unwrap_or(1);
        match shape.shared().1 <= ASKED {
            true => Ok(shape),
            false => Err(LearnError::Mismatch(format!("attention is too large for a block of the device: {shape:?}"))),
        }
    }

    pub fn constants(&self) -> String {
        let Self { width, heads, seen, rotary, group, .. } = self;
        format!("constexpr int E = {width}, H = {heads}, B = {seen}, G = {group};\nconstexpr bool ROTARY = {rotary};")
    }

    /// Shared memory of a block (bytes), forward (q|k|v) and backward (q|k|v, output gradient, probabilities and their
    /// gradients).
    fn shared(&self) -> (usize, usize) {
        let Self { width, heads, seen, tokens: t, group, .. } = self;
        let columns = group * width / heads;
        let forward = 4 * t * (3 * columns + 4);
        (forward, forward + 4 * (t * (columns + 4) + 2 * group * t * seen))
    }

    /// Cosine and sine by position and pair, `[places][d / 2][2]`; empty without rotary positions.
    pub fn rotations(&self, frequencies: &[f64]) -> Vec<[f32; 2]> {
        let places = if self.rotary { self.tokens.max(self.seen) } else { 0 };
        let rotation = |place: usize| frequencies.iter().map(move |f| (place as f64 * f).sin_cos());
        (0..places).flat_map(rotation).map(|(sin, cos)| [cos as f32, sin as f32]).collect()
    }

    /// Number of floats in one environment's stored keys and values of one attention.
    pub fn ring(&self) -> usize {
        self.seen * 2 * self.width
    }

    pub fn forward(&self, d: &Device, windows: usize, qkv: u64, out: u64, rotations: u64) -> DeviceResult {
        let (grid, threads) = self.blocks(windows);
        d.launch("attention_forward", grid, threads, self.shared().0, &args![qkv, out, rotations])
    }

    /// Gradient of `qkv` from the gradient `gradient` of the output.
    pub fn backward(
        &self,
        d: &Device,
        windows: usize,
        qkv: u64,
        gradient: u64,
        out: u64,
        rotations: u64,
    ) -> DeviceResult {
        let (grid, threads) = self.blocks(windows);
        d.launch("attention_backward", grid, threads, self.shared().1, &args![qkv, gradient, out, rotations])
    }

    /// Attention outputs for one new token of each of `rows` environments, from ring buffers of keys and values.
    pub fn stream(&self, d: &Device, rows: usize, [qkv, ring, taken, out, rotations]: [u64; 5]) -> DeviceResult {
        let args = args![qkv, ring, taken, out, rotations, rows];
        d.launch_blocks("attention_stream", (rows * self.heads).div_ceil(8), 256, &args)
    }

    fn blocks(&self, windows: usize) -> ((usize, usize), (usize, usize)) {
        ((windows, self.heads / self.group), ((self.group * self.tokens).next_multiple_of(32), 1))
    }
}
