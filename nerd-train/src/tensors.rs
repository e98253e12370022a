//! Named arrays and metadata in one safetensors file, for the state of runs.

use std::collections::HashMap;
use std::fmt::Display;
use std::str::FromStr;

use nerd_model::transformer::TensorSpec;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::de::DeserializeOwned;

use crate::prelude::*;

/// Arrays and metadata of a safetensors file.
#[derive(Default)]
pub(crate) struct Tensors {
    path: PathBuf,
    parts: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>,
    words: HashMap<String, String>,
}

impl Tensors {
    pub fn put_f32(&mut self, name: impl Into<String>, shape: &[usize], x: &[f32]) {
        self.parts.insert(name.into(), (Dtype::F32, shape.into(), x.iter().flat_map(|v| v.to_le_bytes()).collect()));
    }

    pub fn put_f64(&mut self, name: impl Into<String>, x: impl IntoIterator<Item = f64>) {
        let bytes = x.into_iter().flat_map(f64::to_le_bytes).collect_vec();
        self.parts.insert(name.into(), (Dtype::F64, vec![bytes.len() / 8], bytes));
    }

    pub fn put_u64(&mut self, name: impl Into<String>, x: &[u64]) {
        self.parts.insert(name.into(), (Dtype::U64, vec![x.len()], x.iter().flat_map(|v| v.to_le_bytes()).collect()));
    }

    pub fn put_network(&mut self, tensors: &[TensorSpec], mut flat: &[f32]) {
        for tensor in tensors {
            let entries;
            (entries, flat) = flat.split_at(tensor.len());
            self.put_f32(&tensor.name, &tensor.shape, entries);
        }
    }

    pub fn put_word(&mut self, name: &str, text: impl Into<String>) {
        self.words.insert(name.into(), text.into());
    }

    /// Writes the file atomically.
    pub fn save(&self, path: &Path) -> Result<()> {
        let views = self
            .parts
            .iter()
            .map(|(name, (dtype, shape, bytes))| Ok((name, TensorView::new(*dtype, shape.clone(), bytes)?)));
        let views = views.collect::<Result<Vec<_>, safetensors::SafeTensorError>>().map_err(Error::file(path))?;
        let bytes = safetensors::serialize(views, Some(self.words.clone())).map_err(Error::file(path))?;
        crate::files::write(path, &bytes)
    }

    pub fn open(path: &Path) -> Result<Self> {
        let bytes = nerd_sim::files::read(path).map_err(Error::file(path))?;
        let mut file = Self { path: path.into(), ..Self::default() };
        let wrong = |e: safetensors::SafeTensorError| file.wrong(format!("no safetensors file, or one cut short: {e}"));
        let words = SafeTensors::read_metadata(&bytes).map_err(wrong)?.1.metadata().clone().unwrap_or_default();
        let tensors = SafeTensors::deserialize(&bytes).map_err(wrong)?;
        let part =
            |(name, view): (String, TensorView)| (name, (view.dtype(), view.shape().to_vec(), view.data().to_vec()));
        file.parts = tensors.tensors().into_iter().map(part).collect();
        file.words = words;
        Ok(file)
    }

    pub fn wrong(&self, reason: impl Display) -> Error {
        Error::file(&self.path)(reason)
    }

    pub fn word(&self, name: &str) -> Result<&str> {
        self.words.get(name).map(String::as_str).ok_or_else(|| self.wrong(format!("no `{name}` in its metadata")))
    }

    /// Parses a metadata value.
    pub fn parsed<T: FromStr<Err: Display>>(&self, name: &str) -> Result<T> {
        self.word(name)?.parse().map_err(|e| self.wrong(format!("`{name}`: {e}")))
    }

    pub fn json<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        serde_json::from_str(self.word(name)?).map_err(|e| self.wrong(format!("`{name}`: {e}")))
    }

    /// Reads an array of type `kind`; checks its length against `length`, if given.
    fn numbers<const N: usize, T>(
        &self,
        name: &str,
        kind: Dtype,
        length: Option<usize>,
        read: fn([u8; N]) -> T,
    ) -> Result<Vec<T>> {
        let (dtype, shape, bytes) = self.parts.get(name).ok_or_else(|| self.wrong(format!("no `{name}`")))?;
        if *dtype != kind || length.is_some_and(|n| n != shape.iter().product::<usize>()) {
            return Err(self.wrong(format!("`{name}` is {dtype:?} {shape:?}, expected {kind:?} {length:?}")));
        }
        Ok(bytes.as_chunks().0.iter().map(|b| read(*b)).collect())
    }

    pub fn f32(&self, name: &str, length: Option<usize>) -> Result<Vec<f32>> {
        self.numbers(name, Dtype::F32, length, f32::from_le_bytes)
    }

    pub fn f64(&self, name: &str, length: Option<usize>) -> Result<Vec<f64>> {
        self.numbers(name, Dtype::F64, length, f64::from_le_bytes)
    }

    pub fn u64(&self, name: &str, length: Option<usize>) -> Result<Vec<u64>> {
        self.numbers(name, Dtype::U64, length, u64::from_le_bytes)
    }

    pub fn network(&self, tensors: &[TensorSpec]) -> Result<Vec<f32>> {
        Ok(tensors
            .iter()
            .map(|tensor| self.f32(&tensor.name, Some(tensor.len())))
            .collect::<Result<Vec<_>>>()?
            .concat())
    }
}
