//! What is compared: the bars of the paper's Figure A.2, and a control of our own. h is the number of tokens in a window.

use nerd_train::run::{RunConfig, Variant};

#[derive(Clone, Copy, Debug)]
pub struct Bar {
    pub name: &'static str,
    change: fn(&mut RunConfig),
    /// Read off the figure: errors on the double pendulum and on Ant, divided by NeRD's.
    paper: Option<[f64; 2]>,
}

/// The bar of NeRD itself.
pub const NERD: &str = "h = 10";

const fn bar(name: &'static str, change: fn(&mut RunConfig), paper: Option<[f64; 2]>) -> Bar {
    Bar { name, change, paper }
}

/// In the paper's order. Of h = 20 the paper says only that its loss sometimes explodes.
pub static BARS: [Bar; 13] = [
    bar("LSTM", |run| run.variant = Variant::Lstm, Some([1.8, 7.4])),
    bar("GRU", |run| run.variant = Variant::Gru, Some([4.8, 11.9])),
    bar("MLP", |run| (run.variant, run.history) = (Variant::Mlp, 1), Some([8.9, 11.5])),
    bar("E2E", |run| run.variant = Variant::EndToEnd, Some([56.1, 19.8])),
    bar("Abs Pred", |run| run.variant = Variant::Absolute, Some([26.8, 5.4])),
    bar("World Frame", |run| run.variant = Variant::World, Some([1.1, 23.3])),
    bar("No Inp. Norm", |run| run.variant = Variant::RawInputs, Some([3.3, 3.6])),
    bar("No Out. Norm", |run| run.variant = Variant::RawOutputs, Some([1.6, 5.3])),
    bar("h = 1", alone, Some([4.4, 4.1])),
    bar("h = 5", |run| run.history = 5, Some([2.1, 5.2])),
    bar(NERD, |_| (), Some([1.0, 1.0])),
    bar("h = 20", |run| run.history = 20, None),
    // Our control: as many tokens an update as NeRD has.
    bar("h = 1, 10x", |run| (run.batch, _) = (run.batch * run.history, alone(run)), None),
];

/// A residual network, which has neither heads nor places.
fn alone(run: &mut RunConfig) {
    let usual = RunConfig::default();
    (run.history, run.head_width, run.block) = (1, usual.head_width, usual.block);
}

impl Bar {
    /// The paper's error on a robot, divided by that of NeRD.
    pub fn paper(&self, robot: &str) -> Option<f64> {
        self.paper.map(|[pendulum, ant]| if robot == "ant" { ant } else { pendulum })
    }

    /// The name as a folder and a word of a command line: lower case, `-` between runs of letters and digits.
    pub fn slug(&self) -> String {
        let lower = self.name.to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), " ");
        lower.split_whitespace().collect::<Vec<_>>().join("-")
    }

    /// The settings of NeRD's run with this change, in a folder inside NeRD's.
    pub fn run(&self, nerd: &RunConfig) -> RunConfig {
        let mut run = nerd.clone();
        (self.change)(&mut run);
        run.out = nerd.out.join(self.slug());
        run
    }
}
