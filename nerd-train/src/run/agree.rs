//! What all ranks of a run agree on before it begins.

use super::*;

/// Refuses to begin where ranks were given other settings: they would wait for each other in vain.
pub(super) fn settings(ranks: &Ranks, config: &RunConfig, identity: &Identity) -> Result<(), RankError> {
    let mine = json!({ "run": identity, "minutes": config.minutes, "finish": config.finish, "data": config.data });
    ranks.agree("settings", &mine.to_string(), "give all ranks the same command")
}

/// Refuses to begin where a folder of data, or what a rank has recorded of a chain, is something else than that of rank 0; tokens that
/// ranks record they have from each other.
pub(super) fn data(ranks: &Ranks, config: &RunConfig, sha256: &str) -> Result<(), RankError> {
    if config.data.is_none() && config.unrolled().is_none() {
        return Ok(());
    }
    ranks.agree("data", sha256, "give all ranks the same")
}

/// The state to go on from, as rank 0 has it: sent are updates done (8 bytes, little endian), weights, average, both moments.
pub(super) fn state(ranks: &Ranks, mine: Option<LearnerState>, network: TransformerConfig) -> Result<LearnerState, RankError> {
    if let Some(mine) = mine {
        if ranks.world() > 1 {
            let LearnerState { step, weights, average, m, v } = &mine;
            ranks.share(0, || [step.to_le_bytes().to_vec(), bytes(&weights.flat), bytes(average), bytes(m), bytes(v)].concat())?;
        }
        return Ok(mine);
    }
    let sent = ranks.share(0, Vec::new)?;
    let (step, vectors) = sent.split_first_chunk().unwrap_or((&[0; 8], &[]));
    let n = network.parameters();
    let mut vectors = floats(vectors).chunks(n).map(<[f32]>::to_vec).collect::<Vec<_>>().into_iter();
    let mut next = || {
        let whole = vectors.next().filter(|vector| vector.len() == n);
        whole.ok_or_else(|| RankError(format!("rank 0 sent no state of {n} parameters: give all ranks the same program")))
    };
    let weights = Weights { config: network, flat: next()? };
    Ok(LearnerState { step: u64::from_le_bytes(*step), weights, average: next()?, m: next()?, v: next()? })
}
