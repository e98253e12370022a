//! Errors of a device.

/// One line with the error of a device or its libraries.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("device: {0}")]
pub struct DeviceError(pub String);

pub(crate) fn failed<E: std::fmt::Debug>(what: &'static str) -> impl Fn(E) -> DeviceError {
    move |e| DeviceError(format!("{what}: {e:?}"))
}
