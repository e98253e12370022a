//! Named vectors in one safetensors file, and words beside them.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::checkpoint::CheckpointError;

/// What goes into a file.
#[derive(Default)]
pub struct Writer {
    parts: Vec<(String, Dtype, Vec<usize>, Vec<u8>)>,
}

impl Writer {
    /// f32.
    pub fn f32(&mut self, name: impl Into<String>, shape: &[usize], x: &[f32]) {
        self.parts.push((name.into(), Dtype::F32, shape.into(), x.iter().flat_map(|v| v.to_le_bytes()).collect()));
    }

    /// f64.
    pub fn f64(&mut self, name: impl Into<String>, x: impl IntoIterator<Item = f64>) {
        let bytes: Vec<u8> = x.into_iter().flat_map(f64::to_le_bytes).collect();
        self.parts.push((name.into(), Dtype::F64, vec![bytes.len() / 8], bytes));
    }

    /// u64.
    pub fn u64(&mut self, name: impl Into<String>, x: &[u64]) {
        self.parts.push((name.into(), Dtype::U64, vec![x.len()], x.iter().flat_map(|v| v.to_le_bytes()).collect()));
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path, words: HashMap<String, String>) -> Result<(), CheckpointError> {
        let format = |e: safetensors::SafeTensorError| CheckpointError::Format { path: path.into(), reason: e.to_string() };
        let views = self.parts.iter().map(|(name, dtype, shape, bytes)| Ok((name, TensorView::new(*dtype, shape.clone(), bytes)?)));
        let views = views.collect::<Result<Vec<_>, _>>().map_err(format)?;
        let bytes = safetensors::serialize(views, Some(words)).map_err(format)?;
        nerd_sim::files::write(path, &bytes).map_err(|source| CheckpointError::Io { path: path.into(), source })
    }
}

/// A file that was read.
pub struct Reader<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
    words: HashMap<String, String>,
}

impl<'a> Reader<'a> {
    /// Of the bytes of the file at `path`.
    ///
    /// # Errors
    /// If they are no safetensors.
    pub fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self, CheckpointError> {
        let format = |e: safetensors::SafeTensorError| CheckpointError::Format { path: path.into(), reason: e.to_string() };
        let words = SafeTensors::read_metadata(bytes).map_err(format)?.1.metadata().clone().unwrap_or_default();
        Ok(Self { path, tensors: SafeTensors::deserialize(bytes).map_err(format)?, words })
    }

    /// An error about the file.
    pub fn wrong(&self, reason: impl Into<String>) -> CheckpointError {
        CheckpointError::Format { path: self.path.into(), reason: reason.into() }
    }

    /// A word.
    ///
    /// # Errors
    /// If it is absent.
    pub fn word(&self, name: &str) -> Result<&str, CheckpointError> {
        self.words.get(name).map(String::as_str).ok_or_else(|| self.wrong(format!("no `{name}` in its metadata")))
    }

    fn bytes(&self, name: &str, dtype: Dtype, length: Option<usize>) -> Result<&[u8], CheckpointError> {
        let view = self.tensors.tensor(name).map_err(|e| self.wrong(e.to_string()))?;
        let found: usize = view.shape().iter().product();
        if view.dtype() != dtype || length.is_some_and(|n| n != found) {
            return Err(self.wrong(format!("`{name}` is {:?} {:?}, expected {dtype:?} {length:?}", view.dtype(), view.shape())));
        }
        Ok(view.data())
    }

    /// f32, of a given length if one is given.
    ///
    /// # Errors
    /// If it is absent or something else.
    pub fn f32(&self, name: &str, length: Option<usize>) -> Result<Vec<f32>, CheckpointError> {
        Ok(self.bytes(name, Dtype::F32, length)?.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// f64, of a given length if one is given.
    ///
    /// # Errors
    /// If it is absent or something else.
    pub fn f64(&self, name: &str, length: Option<usize>) -> Result<Vec<f64>, CheckpointError> {
        Ok(self.bytes(name, Dtype::F64, length)?.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect())
    }

    /// u64.
    ///
    /// # Errors
    /// If it is absent or something else.
    pub fn u64(&self, name: &str, length: Option<usize>) -> Result<Vec<u64>, CheckpointError> {
        Ok(self.bytes(name, Dtype::U64, length)?.as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect())
    }
}
