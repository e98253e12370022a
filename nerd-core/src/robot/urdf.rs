//! Reads a robot from URDF.

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// Not a URDF.
    #[error("not a URDF: {0}")]
    Parse(String),
}
