//! Closed-loop fine-tuning by group-relative policy gradients (GRPO, Shao et al., arXiv 2402.03300; for
//! traffic simulation SMART-R1, Pei et al., 2025).
//!
//! The network drives every scene several times, drawing its tokens as the simulator does. Agents are
//! rewarded for staying near the record and fined for contacts that they bring about. What an agent got from
//! a step on, less what it got in the other rollouts of the group, decides whether the token drawn there
//! becomes likelier or less likely. The divergence from the network that the training began with is fined, so
//! that what is not rewarded stays as it was.
//!
//! As in the benchmark, the AV is external: it follows its record whatever the network says.

mod recipe;
mod reward;
mod rollout;
mod task;

pub use recipe::{GrpoRecipe, Rewards};
pub use task::{GroupRelative, TASK};
