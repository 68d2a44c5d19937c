//! A model with what was added to it in; its fit to the training maneuvers, the noise it leaves and
//! the held-out maneuvers with its derivatives out.

pub mod constants;
pub mod found;
pub mod frozen;
pub mod spread;
pub mod stand;
pub mod training;
