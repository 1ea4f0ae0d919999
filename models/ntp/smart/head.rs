//! Token heads.

use burn::module::Module;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, PerceptronKind, indices};

use super::{SmartConfig, TokenCounts};

/// Score of a token that a class does not have.
const ABSENT_TOKEN_SCORE: f32 = -1e9;

/// Head that scores tokens: one for all classes, or one per class.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one of it")]
pub enum TokenHead {
    /// All classes have the same number of tokens.
    Shared(Perceptron),
    /// Classes have different numbers of tokens.
    PerClass(ClassHeads),
}

/// The heads of [`TokenHead::PerClass`].
#[derive(Module, Debug)]
pub struct ClassHeads {
    veh: Perceptron,
    ped: Perceptron,
    cyc: Perceptron,
}

impl TokenHead {
    pub(super) fn init(config: &SmartConfig, init: &mut Initializer) -> Self {
        let h = config.hidden_dim;
        match config.n_token_agent {
            TokenCounts::Shared(count) => Self::Shared(PerceptronKind::SMART.init(&[h, h, count], init)),
            TokenCounts::PerClass { veh, ped, cyc } => Self::PerClass(ClassHeads {
                veh: PerceptronKind::SMART.init(&[h, h, veh], init),
                ped: PerceptronKind::SMART.init(&[h, h, ped], init),
                cyc: PerceptronKind::SMART.init(&[h, h, cyc], init),
            }),
        }
    }

    /// Returns scores [N, tokens] from features [N, h] of agents of these classes. With one head per
    /// class, the number of columns is that of the class with the most tokens; tokens that a class does
    /// not have score -1e9.
    pub(super) fn forward(&self, x: Tensor<2>, classes: &[u8], counts: [usize; 3]) -> Tensor<2> {
        let heads = match self {
            Self::Shared(head) => return head.forward(x),
            Self::PerClass(heads) => [&heads.veh, &heads.ped, &heads.cyc],
        };
        let device = x.device();
        let most = counts.into_iter().max().unwrap_or(0);
        let (mut parts, mut order) = (Vec::new(), vec![0; classes.len()]);
        let mut placed = 0;
        for (class, head) in heads.into_iter().enumerate() {
            let rows: Vec<usize> = (0..classes.len()).filter(|&r| usize::from(classes[r]) == class).collect();
            if rows.is_empty() {
                continue;
            }
            rows.iter().enumerate().for_each(|(i, &r)| order[r] = placed + i);
            placed += rows.len();
            let count = rows.len();
            let scores = head.forward(x.clone().select(0, indices(rows, &device)));
            let fill = Tensor::full([count, most - counts[class]], ABSENT_TOKEN_SCORE, &device);
            parts.push(if most > counts[class] { Tensor::cat(vec![scores, fill], 1) } else { scores });
        }
        if parts.is_empty() {
            return Tensor::zeros([0, most], &device);
        }
        Tensor::cat(parts, 0).select(0, indices(order, &device))
    }
}
