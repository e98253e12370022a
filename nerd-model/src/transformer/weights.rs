//! The network's parameters as one flat f32 vector in the order of [`TransformerConfig::tensors`].
//!
//! All engines exchange this vector (burn modules, the fused CUDA engine, files); optimiser states and moving averages
//! have the same layout. Initial values come from ChaCha8, so one seed gives the same bytes on every device.

use std::collections::HashMap;

use half::f16;
use nerd_sim::sampling::normal;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::program::config::TransformerConfig;
use crate::program::{Init, TensorSpec};

/// Why a file's tensors do not match a network, in one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WeightsError(String);

impl From<safetensors::SafeTensorError> for WeightsError {
    fn from(error: safetensors::SafeTensorError) -> Self {
        Self(format!("not a readable safetensors file: {error}"))
    }
}

/// Precision of parameters in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// All parameters as f32.
    F32,
    /// Matrices of the blocks as f16 (10-bit mantissa, the precision of training on tensor cores). The first and the
    /// last layers stay f32.
    F16,
}

/// All parameters of one network, flat.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Shape of the network.
    pub config: TransformerConfig,
    /// All parameters, tensor after tensor.
    pub flat: Vec<f32>,
}

impl Weights {
    /// Initial parameters for `seed`.
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

    /// Every tensor with its values.
    pub fn iter(&self) -> impl Iterator<Item = (TensorSpec, &[f32])> {
        let mut start = 0;
        self.config.tensors().into_iter().map(move |t| {
            let entries = &self.flat[start..start + t.len()];
            start += t.len();
            (t, entries)
        })
    }

    /// The bytes of a safetensors file with `metadata` in its header.
    pub fn to_bytes(&self, metadata: HashMap<String, String>, storage: Storage) -> Result<Vec<u8>, WeightsError> {
        let hidden = |t: &TensorSpec| t.name.starts_with("blocks.") && t.shape.len() == 2;
        let encode = |(tensor, x): (TensorSpec, &[f32])| match storage {
            Storage::F16 if hidden(&tensor) => {
                (tensor, Dtype::F16, x.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect())
            }
            _ => (tensor, Dtype::F32, x.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        let raw: Vec<(TensorSpec, Dtype, Vec<u8>)> = self.iter().map(encode).collect();
        let views = raw
            .iter()
            .map(|(tensor, dtype, bytes)| Ok((&*tensor.name, TensorView::new(*dtype, tensor.shape.clone(), bytes)?)));
        let views = views.collect::<Result<Vec<_>, WeightsError>>()?;
        Ok(safetensors::serialize(views, Some(metadata))?)
    }

    /// Refuses an impossible configuration, or a file size `found` (bytes) that does not match it. So reading takes no
    /// more memory than the file.
    pub fn check_size(config: &TransformerConfig, found: u64) -> Result<(), WeightsError> {
        config.check().map_err(WeightsError)?;
        let n = config.parameters() as u64;
        // File sizes (bytes) from all parameters in f16 to all in f32 with the longest header.
        let (least, most) = (2 * n, 4 * n + (1 << 24));
        match (least..=most).contains(&found) {
            true => Ok(()),
            false => Err(WeightsError(format!("{found} bytes for {n} parameters: {least} to {most} are needed"))),
        }
    }

    /// Reads the parameters of `config` from the bytes of a safetensors file. The tensors must match exactly and be
    /// finite.
    pub fn from_bytes(config: TransformerConfig, bytes: &[u8]) -> Result<Self, WeightsError> {
        Self::check_size(&config, bytes.len() as u64)?;
        let file = SafeTensors::deserialize(bytes)?;
        let tensors = config.tensors();
        if let Some(name) = file.names().into_iter().find(|name| tensors.iter().all(|t| t.name != **name)) {
            return Err(WeightsError(format!(
                "tensor `{name}` is not one of the configuration's: the file is another network's"
            )));
        }
        let mut flat = Vec::with_capacity(config.parameters());
        for TensorSpec { name, shape, .. } in tensors {
            let wrong =
                |found: String| WeightsError(format!("tensor `{name}`: expected f32 or f16 {shape:?}, found {found}"));
            let view = file.tensor(&name).map_err(|_| wrong("nothing".into()))?;
            let first = flat.len();
            match view.dtype() {
                _ if view.shape() != shape => return Err(wrong(format!("{:?} {:?}", view.dtype(), view.shape()))),
                Dtype::F32 => flat.extend(view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b))),
                Dtype::F16 => flat.extend(view.data().as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32())),
                other => return Err(wrong(format!("{other:?} {:?}", view.shape()))),
            }
            if let Some(entry) = flat[first..].iter().position(|w: &f32| !w.is_finite()) {
                return Err(WeightsError(format!("tensor `{name}`: entry {entry} is {}", flat[first + entry])));
            }
        }
        Ok(Self { config, flat })
    }
}
