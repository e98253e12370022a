//! Training windows: `history` consecutive transitions of one trajectory, normalised, in memory.
//!
//! A window never crosses the end of its trajectory: a trajectory of F frames gives F - `history` + 1 windows. A hash
//! of (seed, step, row) alone chooses the window in row `row` of update `step`. So draws agree on every device and in a
//! resumed run.

/// Normalised inputs and targets of many trajectories of equal length.
#[derive(Clone, Debug, Default)]
pub struct Windows {
    /// Width of a token.
    pub inputs: usize,
    /// Width of a target.
    pub outputs: usize,
    /// Frames in each trajectory.
    pub frames: usize,
    /// Tokens in a window.
    pub history: usize,
    /// Normalised inputs, `[trajectory][frame][inputs]`.
    pub x: Vec<f32>,
    /// Normalised targets, `[trajectory][frame][outputs]`.
    pub y: Vec<f32>,
}

impl Windows {
    /// Number of trajectories.
    pub fn trajectories(&self) -> usize {
        self.x.len().checked_div(self.inputs * self.frames).unwrap_or(0)
    }

    /// Windows in one trajectory; 0 if it is shorter than a window.
    pub fn per_trajectory(&self) -> usize {
        (self.frames + 1).saturating_sub(self.history)
    }

    /// Number of windows.
    pub fn len(&self) -> usize {
        self.trajectories() * self.per_trajectory()
    }

    /// Whether there are no windows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Replaces the trajectories from number `first` on by `fresh`.
    ///
    /// # Errors
    /// If shapes differ, or `fresh` goes beyond the last trajectory.
    pub fn replace(&mut self, first: usize, fresh: &Windows) -> Result<(), String> {
        self.fits(first, fresh, self.trajectories())?;
        self.x[first * self.frames * self.inputs..][..fresh.x.len()].copy_from_slice(&fresh.x);
        self.y[first * self.frames * self.outputs..][..fresh.y.len()].copy_from_slice(&fresh.y);
        Ok(())
    }

    /// Refuses `fresh` if it cannot replace trajectories from number `first` on, out of `trajectories` with this shape.
    pub(crate) fn fits(&self, first: usize, fresh: &Windows, trajectories: usize) -> Result<(), String> {
        let (last, own, other) = (first + fresh.trajectories(), self.shape(), fresh.shape());
        if other == own && last <= trajectories {
            return Ok(());
        }
        Err(format!(
            "fresh trajectories {first}..{last} of (inputs, outputs, frames, history) {other:?} among {trajectories} of {own:?}"
        ))
    }

    fn shape(&self) -> [usize; 4] {
        [self.inputs, self.outputs, self.frames, self.history]
    }

    /// Index of a window's first token, counted from the start of `x`. The window's tokens are consecutive.
    pub fn first_token(&self, window: usize) -> usize {
        window / self.per_trajectory() * self.frames + window % self.per_trajectory()
    }
}

/// Draws the number of the window (below `windows`) in row `row` of update `step`, by three rounds of the splitmix64
/// finaliser.
pub fn draw(seed: u64, step: u64, row: u64, windows: u64) -> u64 {
    mix(mix(mix(seed) ^ step) ^ row) % windows
}

fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
