//! Every operation and network on the CPU against burn: outputs, gradients with respect to weights and tokens.

use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::program::specimens::{TOKENS, WINDOWS, networks, operations};

fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / largest
}

#[test]
fn every_operation_and_its_gradients_are_burns() {
    for specimen in operations().into_iter().chain(networks()) {
        let (name, expected) = (&specimen.name, specimen.by_burn());
        let (loaded, mut memory) = (Loaded::new(specimen.program.clone(), &specimen.flat), Memory::default());
        // Twice, since a pass reuses the memory of the previous one.
        for _ in 0..2 {
            let output = loaded.forward(&specimen.tokens, &mut memory, Pass::Kept(TOKENS)).clone();
            let (by_weights, by_tokens) = loaded.backward(TOKENS, &specimen.upstream, &mut memory, true);
            for ((found, expected), what) in
                [output, by_weights, by_tokens].iter().zip(&expected).zip(["output", "weights", "tokens"])
            {
                let off = apart(found, expected);
                assert!(off < 2e-5, "{name}, {what}: off by {off:.1e} of the largest entry");
            }
        }
        let outputs = specimen.program.width(specimen.program.predictions());
        let rows: Vec<usize> = (0..WINDOWS).map(|w| w * TOKENS + (w + 2) % TOKENS).collect();
        let asked = loaded.forward(&specimen.tokens, &mut Memory::default(), Pass::Windows(TOKENS, &rows)).clone();
        let wanted: Vec<f32> = rows.iter().flat_map(|r| expected[0][r * outputs..][..outputs].to_vec()).collect();
        assert!(apart(&asked, &wanted) < 2e-5, "{name}: rows asked for are not those of the whole pass");
    }
}
