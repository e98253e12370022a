//! The network's parameters as one flat f32 vector in the order of [`TransformerConfig::tensors`].
//!
//! This is the form every engine exchanges (burn modules, the fused CUDA engine, files), and the form in which
//! optimiser states and moving averages are kept. The initial values come from ChaCha8, so the same seed gives the
//! same bytes whatever the device.

use std::collections::HashMap;

use half::f16;
use nerd_sim::sampling::normal;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::program::config::TransformerConfig;
use crate::program::{Init, TensorSpec};

/// A file whose tensors do not fit the configuration.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsError {
    /// Not a safetensors file.
    #[error("not a readable safetensors file: {0}")]
    Format(#[from] safetensors::SafeTensorError),
    /// A tensor is absent, or has another shape or type than it should.
    #[error("tensor `{name}`: expected f32 or f16 {expected:?}, found {found}")]
    Tensor {
        /// Dotted name.
        name: String,
        /// Shape the configuration asks for.
        expected: Vec<usize>,
        /// What the file holds.
        found: String,
    },
    /// The configuration is of no network that can be.
    #[error("{0}")]
    Shape(String),
    /// The file is shorter or longer than the configuration's tensors can be.
    #[error("{found} bytes for {parameters} parameters: at least {} are needed, and no more than {}", least(*parameters), most(*parameters))]
    Size {
        /// Of the configuration.
        parameters: usize,
        /// Of the file.
        found: u64,
    },
    /// A tensor that the configuration does not have.
    #[error("tensor `{0}` is not one of the configuration's: the file is another network's")]
    Unknown(String),
    /// An entry that is not a number.
    #[error("tensor `{name}`: entry {entry} is {value}")]
    NotFinite {
        /// Dotted name.
        name: String,
        /// Row-major, from 0.
        entry: usize,
        /// What it is.
        value: f32,
    },
}

/// Bytes that so many parameters take at least, as f16, and at most, as f32 with all that stands in the header.
fn least(parameters: usize) -> u64 {
    2 * parameters as u64
}

fn most(parameters: usize) -> u64 {
    4 * parameters as u64 + (1 << 24)
}

/// Layout of parameters in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// As they are.
    F32,
    /// Rounded to a mantissa of ten bits, which is all that training on tensor cores sees of them.
    F16,
    /// [Hidden matrices](TensorSpec::hidden) as f16, the few other tensors as they are: these act on all outputs, and
    /// a model that predicts whole frames shows their rounding (`results/f16.md`).
    Mixed,
}

impl Storage {
    /// Of one tensor.
    fn of(self, tensor: &TensorSpec) -> Dtype {
        match self {
            Self::F32 => Dtype::F32,
            Self::F16 => Dtype::F16,
            Self::Mixed if tensor.hidden() => Dtype::F16,
            Self::Mixed => Dtype::F32,
        }
    }
}

/// All parameters of one network, flat.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Shape of the network.
    pub config: TransformerConfig,
    /// Entries, tensor after tensor.
    pub flat: Vec<f32>,
}

impl Weights {
    /// Fresh parameters for `seed`.
    pub fn init(config: TransformerConfig, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut flat = Vec::with_capacity(config.parameters());
        for t in config.tensors() {
            match t.init {
                Init::Constant(c) => flat.resize(flat.len() + t.len(), c as f32),
                Init::Normal(sigma) => flat.extend((0..t.len()).map(|_| (sigma * normal(&mut rng)) as f32)),
                Init::FanIn(n) => {
                    let bound = 1.0 / (n as f64).sqrt();
                    flat.extend((0..t.len()).map(|_| (bound * (2.0 * rng.random::<f64>() - 1.0)) as f32));
                }
            }
        }
        Self { config, flat }
    }

    /// `(name, shape, entries)` of every tensor.
    pub fn iter(&self) -> impl Iterator<Item = (String, Vec<usize>, &[f32])> {
        let mut start = 0;
        self.config.tensors().into_iter().map(move |t| {
            let entries = &self.flat[start..start + t.len()];
            start += t.len();
            (t.name, t.shape, entries)
        })
    }

    /// The bytes of a safetensors file with `metadata` in its header.
    pub fn to_bytes(&self, metadata: HashMap<String, String>, storage: Storage) -> Result<Vec<u8>, WeightsError> {
        let encode = |x: &[f32], dtype: Dtype| -> Vec<u8> {
            match dtype {
                Dtype::F16 => x.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect(),
                _ => x.iter().flat_map(|v| v.to_le_bytes()).collect(),
            }
        };
        let dtypes = self.config.tensors().into_iter().map(|tensor| storage.of(&tensor));
        let raw: Vec<_> = self.iter().zip(dtypes).map(|((name, shape, x), dtype)| (name, shape, dtype, encode(x, dtype))).collect();
        let views = raw.iter().map(|(name, shape, dtype, bytes)| Ok((name.as_str(), TensorView::new(*dtype, shape.clone(), bytes)?)));
        let views = views.collect::<Result<Vec<_>, WeightsError>>()?;
        Ok(safetensors::serialize(views, Some(metadata))?)
    }

    /// Refuses a configuration that cannot be, or a file of so many bytes that cannot be its: what is left to read takes no more
    /// memory than the file.
    ///
    /// # Errors
    /// [`WeightsError::Shape`], [`WeightsError::Size`].
    pub fn check_size(config: &TransformerConfig, found: u64) -> Result<(), WeightsError> {
        config.check().map_err(WeightsError::Shape)?;
        let parameters = config.parameters();
        match (least(parameters)..=most(parameters)).contains(&found) {
            true => Ok(()),
            false => Err(WeightsError::Size { parameters, found }),
        }
    }

    /// Reads the parameters of `config` from the bytes of a safetensors file: exactly its tensors, all of them finite.
    ///
    /// # Errors
    /// What does not fit.
    pub fn from_bytes(config: TransformerConfig, bytes: &[u8]) -> Result<Self, WeightsError> {
        Self::check_size(&config, bytes.len() as u64)?;
        let (file, tensors) = (SafeTensors::deserialize(bytes)?, config.tensors());
        if let Some(name) = file.names().into_iter().find(|name| tensors.iter().all(|t| t.name != **name)) {
            return Err(WeightsError::Unknown(name.to_string()));
        }
        let mut flat = Vec::with_capacity(config.parameters());
        for t in tensors {
            let wrong = |found: String| WeightsError::Tensor { name: t.name.clone(), expected: t.shape.clone(), found };
            let view = file.tensor(&t.name).map_err(|_| wrong("nothing".into()))?;
            match view.dtype() {
                _ if view.shape() != t.shape => return Err(wrong(format!("{:?} {:?}", view.dtype(), view.shape()))),
                Dtype::F32 => flat.extend(view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b))),
                Dtype::F16 => flat.extend(view.data().as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32())),
                other => return Err(wrong(format!("{other:?} {:?}", view.shape()))),
            }
            let entries = &flat[flat.len() - t.len()..];
            if let Some(entry) = entries.iter().position(|w| !w.is_finite()) {
                return Err(WeightsError::NotFinite { value: entries[entry], name: t.name, entry });
            }
        }
        Ok(Self { config, flat })
    }
}
