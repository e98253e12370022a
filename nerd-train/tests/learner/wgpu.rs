//! Training through burn on a GPU, or on a software Vulkan without one (Mesa's lavapipe): losses follow the CPU's.

use burn::tensor::{DeviceKind, DeviceType};
use nerd_model::BurnDevice;

use crate::*;

#[test]
fn losses_on_a_card_follow_the_cpus() {
    if BurnDevice::enumerate(DeviceType::Wgpu).is_empty() {
        println!("skipped: no driver of Vulkan, Metal or DirectX on this machine");
        return;
    }
    let device = BurnDevice::wgpu(DeviceKind::DefaultDevice);
    let rotary = TransformerConfig { positions: Positions::Rotary, history: 2, ..NETWORK };
    let residual = TransformerConfig { architecture: Architecture::Residual, ..NETWORK };
    for (network, huber) in [(NETWORK, None), (rotary, Some(0.5)), (residual, None)] {
        let (config, state) = (LearnerConfig { huber, ..LEARNER }, LearnerState::new(Weights::init(network, 3)));
        let [train, validation] = [windows(0.0), windows(0.5)];
        let mut cpu = CpuLearner::new(config, state.clone(), [train.clone(), validation.clone()]).expect("windows fit");
        let mut card =
            BurnLearner::new(config, state, [train, validation], &device).expect("windows fit").shards(config.batch, 1);
        let mut worst = 0.0f32;
        for update in 0..60 {
            let losses = [&mut cpu as &mut dyn Learner, &mut card].map(|learner| {
                learner.update(3e-3).expect("a finite loss");
                learner.progress().expect("a loss").loss
            });
            let off = (losses[0] - losses[1]).abs() / losses[0];
            worst = worst.max(off);
            assert!(
                off < 1e-3,
                "{:?}, update {update}: loss {} on the card, {} on the CPU",
                network.architecture,
                losses[1],
                losses[0]
            );
        }
        let [own, other] =
            [&mut cpu as &mut dyn Learner, &mut card].map(|learner| learner.validate(100).expect("a loss"));
        println!(
            "{:?}, {:?}: losses of 60 updates at most {worst:.1e} apart, validation {own:.6} and {other:.6}",
            network.architecture, network.positions
        );
        assert!(
            (own - other).abs() < 1e-3 * own,
            "{:?}: validation {other} on the card, {own} on the CPU",
            network.architecture
        );
    }
}
