//! Closed-loop fine-tuning: closest among the top K (CATK, Zhang et al., CVPR 2025, github.com/NVlabs/catk).
//!
//! The network drives all agents; at every step the token is executed that, among the K likeliest, ends
//! nearest to the recorded pose. The label is the token that would lead back to the record. The choice has no
//! gradient, so the rollout is computed first, without gradients and with cached steps, and the loss
//! afterwards, in one pass over all steps, with the same scores.
//!
//! With an external AV, which follows its record whatever the network says, and futures in which agents react
//! to it (`convert --futures`), the same teaches to react.

mod recipe;
mod rollout;
mod task;

pub use recipe::CatkRecipe;
pub use task::{ClosestAmongTopK, TASK};
