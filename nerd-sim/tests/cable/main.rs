//! Cables: against theory, and what their files may say.

mod beam;
mod file;
mod twist;
