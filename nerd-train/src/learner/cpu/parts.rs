//! The flat parameter vector as its tensors, in the order of `TransformerConfig::tensors`; a gradient's likewise.

use nerd_model::transformer::{Positions, TransformerConfig};

/// All tensors of a network, T a slice.
pub struct Parts<T> {
    pub embed: T,
    pub embed_bias: T,
    pub position: Option<T>,
    pub blocks: Vec<Block<T>>,
    pub norm: T,
    pub out: T,
    pub hidden: T,
    pub hidden_bias: T,
    pub head: T,
    pub head_bias: T,
}

/// Those of a block.
pub struct Block<T> {
    pub norm_attn: T,
    pub qkv: T,
    pub proj: T,
    pub norm_mlp: T,
    pub up: T,
    pub down: T,
}

impl<T> Parts<T> {
    /// `take` cuts so many entries off the front of what is left.
    fn new(config: &TransformerConfig, mut take: impl FnMut(usize) -> T) -> Self {
        let mut lengths = config.tensors().into_iter().map(|t| t.len());
        let mut next = || take(lengths.next().unwrap_or(0));
        Self {
            embed: next(),
            embed_bias: next(),
            position: (config.positions == Positions::Table).then(&mut next),
            blocks: (0..config.layers)
                .map(|_| Block { norm_attn: next(), qkv: next(), proj: next(), norm_mlp: next(), up: next(), down: next() })
                .collect(),
            norm: next(),
            out: next(),
            hidden: next(),
            hidden_bias: next(),
            head: next(),
            head_bias: next(),
        }
    }

    /// Layer norms' weights with the matrices behind them.
    pub fn normed(self) -> impl Iterator<Item = (T, T)> {
        let blocks = self.blocks.into_iter().flat_map(|b| [(b.norm_attn, b.qkv), (b.norm_mlp, b.up)]);
        blocks.chain([(self.norm, self.out)])
    }
}

impl<'a> Parts<&'a [f32]> {
    /// Of parameters.
    pub fn of(config: &TransformerConfig, mut flat: &'a [f32]) -> Self {
        Self::new(config, |n| flat.split_off(..n).unwrap_or_default())
    }
}

impl<'a> Parts<&'a mut [f32]> {
    /// Of a gradient.
    pub fn of_mut(config: &TransformerConfig, mut flat: &'a mut [f32]) -> Self {
        Self::new(config, |n| flat.split_off_mut(..n).unwrap_or_default())
    }
}
