//! The network's parameters as one flat f32 vector in the order of [`TransformerConfig::tensors`].
//!
//! This is the form every engine exchanges (burn modules, the fused CUDA engine, files), and the form in which
//! optimiser states and moving averages are kept. The initial values come from ChaCha8, so the same seed gives the
//! same bytes whatever the device.

use std::collections::HashMap;

use half::f16;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::config::{Init, TransformerConfig};

/// A file whose tensors do not fit the configuration.
#[derive(Debug, thiserror::Error)]
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
}

/// How parameters stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// As they are.
    F32,
    /// Rounded to a mantissa of ten bits, which is all that training on tensor cores sees of them.
    F16,
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
        let encode = |x: &[f32]| -> Vec<u8> {
            match storage {
                Storage::F32 => x.iter().flat_map(|v| v.to_le_bytes()).collect(),
                Storage::F16 => x.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect(),
            }
        };
        let dtype = if storage == Storage::F32 { Dtype::F32 } else { Dtype::F16 };
        let raw: Vec<_> = self.iter().map(|(name, shape, x)| (name, shape, encode(x))).collect();
        let views = raw.iter().map(|(name, shape, bytes)| Ok((name.as_str(), TensorView::new(dtype, shape.clone(), bytes)?)));
        let views = views.collect::<Result<Vec<_>, WeightsError>>()?;
        Ok(safetensors::serialize(views, Some(metadata))?)
    }

    /// Reads the parameters of `config` from the bytes of a safetensors file.
    pub fn from_bytes(config: TransformerConfig, bytes: &[u8]) -> Result<Self, WeightsError> {
        let file = SafeTensors::deserialize(bytes)?;
        let mut flat = Vec::with_capacity(config.parameters());
        for t in config.tensors() {
            let wrong = |found: String| WeightsError::Tensor { name: t.name.clone(), expected: t.shape.clone(), found };
            let view = file.tensor(&t.name).map_err(|_| wrong("nothing".into()))?;
            match view.dtype() {
                _ if view.shape() != t.shape => return Err(wrong(format!("{:?} {:?}", view.dtype(), view.shape()))),
                Dtype::F32 => flat.extend(view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
                Dtype::F16 => flat.extend(view.data().chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32())),
                other => return Err(wrong(format!("{other:?} {:?}", view.shape()))),
            }
        }
        Ok(Self { config, flat })
    }
}

/// One N(0, 1) number (Box and Muller).
fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}
