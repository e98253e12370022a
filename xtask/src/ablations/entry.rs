//! What is compared: the bars of the paper's Figure A.2, and controls of our own.

use nerd_train::run::{RunConfig, Variant};

/// One bar.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Under the bar, and the name of its folder.
    pub name: &'static str,
    /// Column of the figure: a (architectures), b (other decisions), c (window), d (controls that the paper has not).
    pub group: char,
    /// Design.
    pub variant: Variant,
    /// Tokens of a window; a perceptron's is one, whatever stands here.
    pub history: usize,
    /// Windows of an update, in NeRD's.
    pub batches: usize,
    /// Error divided by NeRD's, read off the paper's bars: double pendulum, Ant.
    pub paper: Option<[f64; 2]>,
}

/// NeRD's window (tokens).
const H: usize = 10;

const fn entry(name: &'static str, group: char, variant: Variant, history: usize, batches: usize, paper: Option<[f64; 2]>) -> Entry {
    Entry { name, group, variant, history, batches, paper }
}

/// All of them, in the paper's order; NeRD is `h = 10`. The paper says of h = 20 only that its loss sometimes explodes.
pub const ENTRIES: [Entry; 13] = [
    entry("LSTM", 'a', Variant::Lstm, H, 1, Some([1.8, 7.4])),
    entry("GRU", 'a', Variant::Gru, H, 1, Some([4.8, 11.9])),
    entry("MLP", 'a', Variant::Mlp, 1, 1, Some([8.9, 11.5])),
    entry("E2E", 'b', Variant::EndToEnd, H, 1, Some([56.1, 19.8])),
    entry("Abs Pred", 'b', Variant::Absolute, H, 1, Some([26.8, 5.4])),
    entry("World Frame", 'b', Variant::World, H, 1, Some([1.1, 23.3])),
    entry("No Inp. Norm", 'b', Variant::RawInputs, H, 1, Some([3.3, 3.6])),
    entry("No Out. Norm", 'b', Variant::RawOutputs, H, 1, Some([1.6, 5.3])),
    entry("h = 1", 'c', Variant::Nerd, 1, 1, Some([4.4, 4.1])),
    entry("h = 5", 'c', Variant::Nerd, 5, 1, Some([2.1, 5.2])),
    entry(NERD, 'c', Variant::Nerd, H, 1, Some([1.0, 1.0])),
    entry("h = 20", 'c', Variant::Nerd, 20, 1, None),
    entry("h = 1, 10x", 'd', Variant::Nerd, 1, H, None),
];

/// The bar that all others are divided by.
pub const NERD: &str = "h = 10";

impl Entry {
    /// Letters and digits of the name, for a folder.
    pub fn folder(&self) -> String {
        let lower = self.name.to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), " ");
        lower.split_whitespace().collect::<Vec<_>>().join("-")
    }

    /// Tokens of an update, in NeRD's: what its training costs, roughly.
    pub fn cost(&self) -> f64 {
        // Small updates cost more than their tokens.
        (self.history * self.batches) as f64 / H as f64 + 0.1
    }

    /// How it is trained, given how NeRD is.
    pub fn train(&self, nerd: &RunConfig) -> RunConfig {
        let mut run = nerd.clone();
        (run.variant, run.history) = (self.variant, self.history);
        (run.batch, run.out) = (nerd.batch * self.batches, nerd.out.join(self.folder()));
        run
    }
}
