//! Errors of the CUDA driver and its libraries.

/// An error of a device or its libraries, in one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("device: {0}")]
pub struct DeviceError(pub String);

/// What a device did, or why it did not.
pub type DeviceResult<T = ()> = Result<T, DeviceError>;

pub(crate) fn failed<E: std::fmt::Debug>(what: &'static str) -> impl Fn(E) -> DeviceError {
    move |e| DeviceError(format!("{what}: {e:?}"))
}
