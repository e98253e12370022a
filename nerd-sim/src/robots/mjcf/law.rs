//! Actuator laws: force from control, position and velocity.

/// The force of an actuator: gain times control plus bias.
#[derive(Clone, Debug)]
pub(super) struct Law {
    pub gain_kind: String,
    pub bias_kind: String,
    pub gain: f64,
    /// Constant, coefficient of position, coefficient of velocity. A positive coefficient of velocity is a damping
    /// ratio.
    pub bias: [f64; 3],
}

impl Law {
    pub fn new(bias_kind: &str, bias: [f64; 3]) -> Self {
        Self { gain_kind: "fixed".into(), bias_kind: bias_kind.into(), gain: 1.0, bias }
    }
}

/// Default law of `<motor>`.
pub(super) fn motor() -> Law {
    Law::new("none", [0.0; 3])
}

/// Default laws of `<position>` and `<velocity>`.
pub(super) fn servos() -> [Law; 2] {
    [Law::new("affine", [0.0, -1.0, 0.0]), Law::new("affine", [0.0, 0.0, -1.0])]
}
