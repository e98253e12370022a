//! Modes of a training run, and the settings that each of them refuses.

use nerd_model::chain::{self, Chain};

use super::*;

/// Default minimum of tokens in a training sequence: in short ones, few tokens have a full history.
const SEQUENCE: usize = 32;

/// How a run trains; [`RunConfig::mode`] makes it from settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// NeRD learns single predictions, from windows of recorded frames.
    Windows {
        /// Content of tokens and meaning of predictions.
        form: Form,
        /// Frames that a prediction depends on.
        context: Context,
    },
    /// NeRD that sees single frames continues from a trained model, through rollouts.
    Rollouts {
        /// Content of tokens and meaning of predictions.
        form: Form,
        /// Frames of a rollout in training.
        frames: usize,
    },
    /// A network with a token per rod learns a cable, through rollouts.
    Chain {
        /// Frames of a rollout in training.
        frames: usize,
    },
}

/// Frames that a prediction depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Context {
    /// The present frame alone: a residual network without attention.
    Frame,
    /// A window of `history` frames, evaluated anew for every frame.
    Window {
        /// Tokens that a token attends to, itself included.
        history: usize,
        /// Columns of an attention head.
        head_width: usize,
    },
    /// Earlier frames, through rotary positions and a cache of keys and values: a rollout evaluates one token per
    /// frame.
    Stream {
        /// Tokens that a token attends to in each layer, itself included.
        history: usize,
        /// Columns of an attention head.
        head_width: usize,
        /// Tokens of a training sequence, unless it is derived from `history`.
        sequence: Option<usize>,
    },
}

impl RunConfig {
    /// The mode of these settings. Refuses settings that this mode does not use.
    pub fn mode(&self) -> Result<Mode> {
        self.used()?;
        let Self { base, view, condition_on_params: told, history, head_width, sequence, .. } = *self;
        let form = Form { base, view, told };
        let frames = sequence.unwrap_or(1);
        let mode = match self.variant {
            Variant::Chain => Mode::Chain { frames },
            Variant::Nerd if self.rolls_out() && self.from.is_none() => {
                refuse!(
                    "--sequence with --history 1 goes on from a model that knows single frames: give it with --from"
                )
            }
            Variant::Nerd if self.rolls_out() => Mode::Rollouts { form, frames },
            Variant::Nerd if self.stream => {
                Mode::Windows { form, context: Context::Stream { history, head_width, sequence } }
            }
            Variant::Nerd if history == 1 => Mode::Windows { form, context: Context::Frame },
            Variant::Nerd => Mode::Windows { form, context: Context::Window { history, head_width } },
        };
        let devices = mode.devices();
        if !devices.contains(&self.device) {
            let devices = devices.iter().map(Device::to_string).join(", ");
            refuse!("--device {} does not train this run: choose from {devices}", self.device);
        }
        Ok(mode)
    }

    /// Whether NeRD of single frames is trained through rollouts.
    fn rolls_out(&self) -> bool {
        self.variant == Variant::Nerd && self.history == 1 && !self.stream && self.sequence > Some(1)
    }

    /// Refuses settings that differ from their defaults but have no effect together with the other settings.
    fn used(&self) -> Result<()> {
        let chain = self.variant == Variant::Chain;
        let rolled = self.rolls_out();
        let log = self.log().is_some();
        let sequences = self.stream || chain || self.history == 1 || self.sequence <= Some(1);
        let unused: [(bool, &str, &[&str]); 9] = [
            (
                chain,
                "with --variant chain",
                &["stream", "base", "view", "condition-on-params", "fresh-transitions", "epsilon", "huber"],
            ),
            (rolled, "where --sequence rolls out", &["condition-on-params", "fresh-transitions", "huber"]),
            (
                log,
                "with recorded motion of --data, which names its robot and is the truth",
                &["robot", "truth", "condition-on-params", "variant"],
            ),
            (!log, "without a log as --data", &["held-out"]),
            (self.data.is_some(), "with --data: nothing is recorded", &["fresh-transitions", "policy"]),
            (self.from.is_some(), "with --from, whose model has its own", &["epsilon"]),
            (self.history == 1 && !self.stream && !chain, "with --history 1, which has no attention", &["head-width"]),
            (!sequences, "without --stream, --variant chain or NeRD with --history 1", &["sequence"]),
            (self.device != Device::Cuda, "without --device cuda", &["f32"]),
        ];
        let own = self.given();
        let usual = Self::default().given();
        let changed = |key: &&&str| own[**key] != usual[**key];
        match unused.iter().filter(|row| row.0).find_map(|(_, why, keys)| Some((keys.iter().find(changed)?, why))) {
            Some((key, why)) => refuse!("--{key} means nothing {why}; leave it out"),
            None => Ok(()),
        }
    }
}

impl Mode {
    /// Content of tokens and meaning of predictions.
    pub fn form(&self) -> Form {
        match *self {
            Self::Windows { form, .. } | Self::Rollouts { form, .. } => form,
            Self::Chain { .. } => Form::default(),
        }
    }

    /// Frames of a rollout in training, if training goes through rollouts.
    pub fn frames(&self) -> Option<usize> {
        match *self {
            Self::Windows { .. } => None,
            Self::Rollouts { frames, .. } | Self::Chain { frames, .. } => Some(frames),
        }
    }

    /// Devices that can train in this mode.
    fn devices(&self) -> &'static [Device] {
        match self {
            Self::Windows { .. } => &[Device::Cpu, Device::Cuda, Device::Flex, Device::Wgpu],
            Self::Rollouts { .. } => &[Device::Cpu],
            Self::Chain { .. } => &[Device::Cpu, Device::Cuda],
        }
    }

    /// Shape of the network for `system`.
    pub fn network(&self, system: &System, embedding: usize, layers: usize) -> Result<TransformerConfig> {
        let wrong = |reason: String| Error::Refused(format!("--embedding {embedding}, --layers {layers}: {reason}"));
        let paper =
            |inputs, outputs| TransformerConfig { layers, ..TransformerConfig::paper(inputs, outputs, embedding) };
        let robot = || paper(Features::inputs(system, self.form()), Features::outputs(system));
        let single = |network, block, architecture| TransformerConfig {
            heads: 1,
            block,
            history: 1,
            head: 1,
            architecture,
            ..network
        };
        let heads = |head_width: usize| (embedding / head_width.max(1)).max(1);
        let network = match *self {
            Self::Chain { .. } => {
                let rods = Chain::of(system)?.rods;
                single(paper(chain::INPUTS, chain::OUTPUTS), rods, Architecture::Chain)
            }
            Self::Rollouts { .. } | Self::Windows { context: Context::Frame, .. } => {
                single(robot(), 1, Architecture::Residual)
            }
            Self::Windows { context: Context::Window { history, head_width }, .. } => {
                let network = robot();
                TransformerConfig { heads: heads(head_width), history, block: network.block.max(history), ..network }
            }
            Self::Windows { context: Context::Stream { history, head_width, sequence }, .. } => {
                let network =
                    TransformerConfig { heads: heads(head_width), history, positions: Positions::Rotary, ..robot() };
                // By default a sequence has all frames that a rollout's prediction depends on: training then covers the
                // longest history.
                TransformerConfig { block: sequence.unwrap_or(network.reach().max(SEQUENCE)).max(history), ..network }
            }
        };
        network.check().map_err(wrong)?;
        Ok(network)
    }
}
