//! The attention layer and the embeddings, edge by edge in plain loops of f64, by the names and layouts of a
//! state dict.

use reactsim::models::nn::Tensors;

pub(crate) type Rows = Vec<Vec<f64>>;

pub(crate) struct Naive<'a> {
    weights: &'a Tensors<'a>,
    /// Prefix of the layer's names, without the dot.
    at: String,
}

impl<'a> Naive<'a> {
    pub(crate) fn new(weights: &'a Tensors<'a>, at: impl Into<String>) -> Self {
        Self { weights, at: at.into() }
    }

    fn floats(&self, name: &str) -> Option<(Vec<usize>, Vec<f64>)> {
        let name = if self.at.is_empty() { name.to_owned() } else { format!("{}.{name}", self.at) };
        let (shape, values) = self.weights.floats(&name).ok()?;
        Some((shape.to_vec(), values.into_iter().map(f64::from).collect()))
    }

    /// y = x Wᵀ + b.
    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let (shape, weight) = self.floats(&format!("{name}.weight")).unwrap();
        assert_eq!(x.len(), shape[1]);
        let bias = self.floats(&format!("{name}.bias")).map(|b| b.1);
        let row = |o: usize| {
            let sum: f64 = x.iter().zip(&weight[o * shape[1]..]).map(|(a, b)| a * b).sum();
            sum + bias.as_ref().map_or(0.0, |b| b[o])
        };
        (0..shape[0]).map(row).collect()
    }

    fn norm(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let gain = self.floats(&format!("{name}.weight")).unwrap().1;
        let bias = self.floats(&format!("{name}.bias")).unwrap().1;
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / x.len() as f64;
        (0..x.len()).map(|i| (x[i] - mean) / (variance + 1e-5).sqrt() * gain[i] + bias[i]).collect()
    }

    /// Returns the Fourier embedding of some scalars.
    pub(crate) fn fourier(&self, scalars: &[f64]) -> Vec<f64> {
        let (shape, frequencies) = self.floats("freqs.weight").unwrap();
        let mut sum = Vec::new();
        for (d, u) in scalars.iter().enumerate() {
            let angles: Vec<f64> = frequencies[d * shape[1]..][..shape[1]]
                .iter()
                .map(|f| std::f64::consts::TAU * f * u)
                .collect();
            let mut features: Vec<f64> = angles.iter().map(|a| a.cos()).collect();
            features.extend(angles.iter().map(|a| a.sin()));
            features.push(*u);
            let x = relu(self.norm(&format!("mlps.{d}.1"), &self.linear(&format!("mlps.{d}.0"), &features)));
            add(&mut sum, &self.linear(&format!("mlps.{d}.3"), &x));
        }
        self.linear("to_out.2", &relu(self.norm("to_out.0", &sum)))
    }

    /// Computes one attention layer from features of destinations and sources and edges (source, destination)
    /// with their relations.
    pub(crate) fn attention(
        &self,
        heads: usize,
        dst: &Rows,
        src: &Rows,
        edges: &[(usize, usize)],
        relations: &Rows,
    ) -> Rows {
        let own_norm = if self.floats("attn_prenorm_x_dst.weight").is_some() {
            "attn_prenorm_x_dst"
        } else {
            "attn_prenorm_x_src"
        };
        let normed: Rows = src.iter().map(|s| self.norm("attn_prenorm_x_src", s)).collect();
        let mut out = Rows::new();
        for (at, raw) in dst.iter().enumerate() {
            let own = self.norm(own_norm, raw);
            let query = self.linear("to_q", &own);
            let dim = query.len() / heads;
            let mut keys = Rows::new();
            let mut values = Rows::new();
            for (edge, _) in edges.iter().enumerate().filter(|(_, e)| e.1 == at) {
                let n = match self.floats("attn_prenorm_r.weight") {
                    Some(_) => self.norm("attn_prenorm_r", &relations[edge]),
                    None => relations[edge].clone(),
                };
                let source = &normed[edges[edge].0];
                let mut key = self.linear("to_k", source);
                add(&mut key, &self.linear("to_k_r", &n));
                let mut value = self.linear("to_v", source);
                add(&mut value, &self.linear("to_v_r", &n));
                keys.push(key);
                values.push(value);
            }
            let mut message = vec![0.0; query.len()];
            for head in 0..heads {
                let span = head * dim..(head + 1) * dim;
                let scores: Vec<f64> = keys
                    .iter()
                    .map(|k| span.clone().map(|i| query[i] * k[i]).sum::<f64>() / (dim as f64).sqrt())
                    .collect();
                let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let total: f64 = scores.iter().map(|s| (s - top).exp()).sum::<f64>() + 1e-16;
                for (score, value) in scores.iter().zip(&values) {
                    span.clone().for_each(|i| message[i] += (score - top).exp() / total * value[i]);
                }
            }
            let gate = self.linear("to_g", &[message.clone(), own.clone()].concat());
            let transform = self.linear("to_s", &own);
            let mixed: Vec<f64> = (0..message.len())
                .map(|i| message[i] + (transform[i] - message[i]) / (1.0 + (-gate[i]).exp()))
                .collect();
            let mut x = raw.clone();
            add(&mut x, &self.norm("attn_postnorm", &self.linear("to_out", &mixed)));
            let inner = self.norm("ff_prenorm", &x);
            let ff = if self.floats("ff_mlp.0.weight").is_some() {
                self.linear("ff_mlp.3", &relu(self.linear("ff_mlp.0", &inner)))
            } else {
                let both = self.linear("ff_mlp.w12", &inner);
                let half = both.len() / 2;
                let hidden: Vec<f64> =
                    (0..half).map(|i| both[i] / (1.0 + (-both[i]).exp()) * both[half + i]).collect();
                self.linear("ff_mlp.w3", &hidden)
            };
            add(&mut x, &self.norm("ff_postnorm", &ff));
            out.push(x);
        }
        out
    }
}

fn relu(x: Vec<f64>) -> Vec<f64> {
    x.into_iter().map(|v| v.max(0.0)).collect()
}

/// Adds to a sum, which may be empty.
fn add(sum: &mut Vec<f64>, x: &[f64]) {
    sum.resize(x.len(), 0.0);
    sum.iter_mut().zip(x).for_each(|(a, b)| *a += b);
}
