//! Runs from their settings to their models, and how far models are from the truth.

mod evaluate;
mod settings;
