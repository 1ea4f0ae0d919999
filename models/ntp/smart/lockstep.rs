//! Evaluation of several scenes in one forward pass. The features of all scenes stay in tensors that the
//! scenes share, so that the number of operations does not grow with the number of scenes.

use std::collections::VecDeque;

use burn::tensor::Tensor;
use reactsim_nn::{Noise, RowCollector, SharedRows};

use super::relation::Pose;
use super::tables::pick;
use super::{Agents, CachedScene, Edges, EncodedMap, Links, MapTokens, Smart, Step, TokenTables};

impl Smart {
    /// Encodes maps, which must have been checked.
    pub(super) fn encode_maps(&self, tables: &TokenTables, maps: &[&MapTokens]) -> Vec<EncodedMap> {
        let (mut edges, mut first) = (Edges::new(3), 0);
        for map in maps {
            edges.append(&Edges::among_map(self.config(), map), first, first);
            first += map.len();
        }
        self.encode_maps_with(tables, maps, &edges)
    }

    /// Like [`Smart::encode_maps`], with given pairs of map tokens, which are numbered through all maps.
    pub(super) fn encode_maps_with(
        &self,
        tables: &TokenTables,
        maps: &[&MapTokens],
        edges: &Edges,
    ) -> Vec<EncodedMap> {
        let mut all = MapTokens::default();
        maps.iter().for_each(|map| all.append(map));
        let features = self.map_encoder.forward(tables, &all, edges, &mut Noise::none(), &mut |_, _| {});
        let sources = self.agent_encoder.pt2a_attn_layers.iter();
        let sources = if all.is_empty() {
            sources.map(|_| features.clone()).collect()
        } else {
            sources.map(|layer| layer.sources(features.clone())).collect()
        };
        let sources = SharedRows::divide(sources, maps.iter().map(|map| map.len()));
        let encoded = |(map, sources): (&&MapTokens, _)| EncodedMap {
            poses: Pose::all(&map.position, &map.orientation),
            sources,
        };
        maps.iter().zip(sources).map(encoded).collect()
    }

    /// Starts scenes without steps. The agents must have been checked.
    pub(super) fn begin_all(
        &self,
        tables: &TokenTables,
        scenes: Vec<(EncodedMap, Agents)>,
    ) -> Vec<CachedScene> {
        let mut all = Agents::default();
        scenes.iter().for_each(|(_, agents)| all.append(agents));
        let identities = self.agent_encoder.identities(&all, &tables.device());
        let identities = SharedRows::divide(vec![identities], scenes.iter().map(|(_, agents)| agents.len()));
        let begun = |((map, agents), identities)| CachedScene {
            map,
            agents,
            identities,
            steps: VecDeque::new(),
            pasts: VecDeque::new(),
        };
        scenes.into_iter().zip(identities).map(begun).collect()
    }

    /// Adds the next steps of scenes, which must have been checked. Returns the scores of the next tokens,
    /// [agents of all scenes, tokens].
    pub(super) fn step_all(&self, tables: &TokenTables, scenes: Vec<(&mut CachedScene, Step)>) -> Tensor<2> {
        let classes: Vec<u8> = scenes.iter().flat_map(|(e, _)| e.agents.class.iter().copied()).collect();
        let x = self.advance_all(tables, scenes);
        let counts = self.config().n_token_agent.of_classes();
        if classes.is_empty() {
            return Tensor::zeros([0, counts.into_iter().max().unwrap_or(0)], &x.device());
        }
        self.agent_encoder.token_predict_head.forward(x, &classes, counts)
    }

    /// Adds the next steps of scenes, which must have been checked. Returns their features, [agents of all
    /// scenes, h].
    pub(super) fn advance_all(
        &self,
        tables: &TokenTables,
        mut scenes: Vec<(&mut CachedScene, Step)>,
    ) -> Tensor<2> {
        let (config, layers, device) = (self.config(), &self.agent_encoder, tables.device());
        let counts: Vec<usize> = scenes.iter().map(|(scene, _)| scene.agents.len()).collect();
        let nodes: usize = counts.iter().sum();
        let pass = Pass::of(&scenes);
        let tokens = scenes
            .iter()
            .flat_map(|(scene, step)| scene.agents.class.iter().copied().zip(step.token.iter().copied()));
        let tokens = tables.agents(tokens);
        if nodes == 0 {
            return tokens;
        }
        let mut x = layers.embed(tokens, pass.identities(), &pass.motion);

        let (mut own, mut from_map, mut among) = (Edges::new(4), Edges::new(3), Edges::new(3));
        let mut first = 0;
        for ((scene, step), rows) in scenes.iter_mut().zip(&pass.rows) {
            let step = std::mem::take(step);
            let mut seen = Edges::new(3);
            seen.add_from_map(config, &scene.map.poses, &step, |agent| agent);
            from_map.append(&seen, rows.map, first);
            among.among_agents(config, &step, |agent| first + agent);
            scene.steps.push_back(step);
            let steps = scene.steps.make_contiguous();
            let visible: Vec<Vec<bool>> = steps.iter().map(|s| s.valid.clone()).collect();
            let newest = steps.len() - 1;
            let source = |agent: usize, step: usize| rows.past[step] + agent;
            let over_time =
                Edges::over_time(config, steps, &visible, newest..newest + 1, source, |agent, _| agent);
            own.append(&over_time, 0, first);
            first += rows.agents;
        }
        let own = Links::new(&own, nodes, &layers.r_t_emb, &device);
        let from_map = Links::new(&from_map, nodes, &layers.r_pt2a_emb, &device);
        let among = Links::new(&among, nodes, &layers.r_a2a_emb, &device);

        let noise = &mut Noise::none();
        let (past, map) = (pass.past.joined(), pass.map.joined().unwrap_or_default());
        let mut entering = Vec::with_capacity(config.num_agent_layers);
        for i in 0..config.num_agent_layers {
            let layer = &layers.t_attn_layers[i];
            let sources = layer.sources(x.clone());
            let earlier = past.as_ref().map_or_else(|| sources.clone(), |past| past[i].clone());
            x = layer.forward(x, earlier, &own.neighbors, &own.relations, noise);
            entering.push(sources);
            let layer = &layers.pt2a_attn_layers[i];
            x = layer.forward(x, map[i].clone(), &from_map.neighbors, &from_map.relations, noise);
            let layer = &layers.a2a_attn_layers[i];
            let sources = layer.sources(x.clone());
            x = layer.forward(x, sources, &among.neighbors, &among.relations, noise);
        }
        for ((scene, _), entering) in scenes.iter_mut().zip(SharedRows::divide(entering, counts)) {
            scene.pasts.push_back(entering);
            if scene.steps.len() > config.window() {
                scene.steps.pop_front();
                scene.pasts.pop_front();
            }
        }
        x
    }
}

/// The rows of several scenes in the tensors of one forward pass.
#[derive(Default)]
struct Pass {
    identities: RowCollector,
    map: RowCollector,
    past: RowCollector,
    rows: Vec<SceneRows>,
    /// Distance (m) and bearing (rad) of the last displacement of each agent.
    motion: Vec<[f32; 2]>,
}

/// First rows of a scene.
struct SceneRows {
    identities: usize,
    map: usize,
    /// First row of each earlier step.
    past: Vec<usize>,
    /// Number of agents.
    agents: usize,
}

impl Pass {
    fn of(scenes: &[(&mut CachedScene, Step)]) -> Self {
        let mut pass = Self::default();
        for (scene, step) in scenes {
            let before = scene.steps.back();
            pass.motion.extend((0..scene.agents.len()).map(|a| {
                let own = Pose::new(step.position[a], step.heading[a]);
                before.map_or([0.0; 2], |b| own.motion(b.position[a]))
            }));
            let rows = SceneRows {
                identities: pass.identities.add(&scene.identities),
                map: pass.map.add(&scene.map.sources),
                past: scene.pasts.iter().map(|past| pass.past.add(past)).collect(),
                agents: scene.agents.len(),
            };
            pass.rows.push(rows);
        }
        pass
    }

    /// Returns the features of class and shape of all agents, [N, h].
    ///
    /// # Panics
    /// If there is no scene.
    fn identities(&self) -> Tensor<2> {
        let joined = self.identities.joined().expect("a scene with agents");
        let rows = self.rows.iter().flat_map(|rows| rows.identities..rows.identities + rows.agents);
        if rows.clone().eq(0..self.identities.rows()) { joined[0].clone() } else { pick(&joined[0], rows) }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use reactsim_nn::{Initializer, device};

    use super::super::super::tokens::TOKEN_STEPS;
    use super::super::{SmartConfig, TokenShapes};
    use super::*;

    const STEPS: usize = 6;

    fn config() -> SmartConfig {
        let config = r#"{"hidden_dim": 16, "num_freq_bands": 4, "num_heads": 2, "head_dim": 4, "dropout": 0.1,
            "num_map_layers": 1, "num_agent_layers": 2, "pl2pl_radius": 6, "pl2a_radius": 12, "a2a_radius": 30,
            "time_span": 15, "n_token_map": 5, "mlp_embedding_first_width": 16,
            "n_token_agent": {"veh": 9, "ped": 7, "cyc": 8}}"#;
        SmartConfig::from_json(config).unwrap()
    }

    /// Returns shapes of tokens, drawn at random.
    fn token_shapes(config: &SmartConfig, stream: &mut ChaCha8Rng) -> TokenShapes {
        let counts = config.n_token_agent.of_classes();
        let agents =
            counts.map(|n| (0..n).map(|_| std::array::from_fn(|_| stream.random_range(-3.0..8.0))).collect());
        let map = (0..config.n_token_map)
            .map(|_| std::array::from_fn(|_| stream.random_range(-1.0..5.0)))
            .collect();
        TokenShapes { agents, map }
    }

    /// A scene of agents and pieces of map within 20 m, with its steps.
    fn scene(seed: u64, agents: usize, pieces: usize) -> (MapTokens, Agents, Vec<Step>) {
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        let mut map = MapTokens::default();
        for _ in 0..pieces {
            map.position.push(std::array::from_fn(|_| stream.random_range(-20.0..20.0)));
            map.orientation.push(stream.random_range(-3.0..3.0));
            map.token.push(stream.random_range(0..5));
            map.kind.push(1);
            map.polygon.push(0);
            map.light.push(stream.random_range(0..3));
        }
        let class = (0..agents).map(|a| (a % 3) as u8).collect();
        let shape = (0..agents).map(|_| [stream.random_range(0.5..5.0), 1.0, 1.6]).collect();
        let step = |_| Step {
            position: (0..agents)
                .map(|_| std::array::from_fn(|_| stream.random_range(-20.0..20.0)))
                .collect(),
            heading: (0..agents).map(|_| stream.random_range(-3.0..3.0)).collect(),
            valid: (0..agents).map(|_| stream.random_range(0..5) > 0).collect(),
            token: (0..agents).map(|_| stream.random_range(0..7)).collect(),
        };
        (map, Agents { class, shape }, (0..STEPS).map(step).collect())
    }

    /// Runs scenes together, the third one only until step 3 and the fourth one from step 2 on. Returns the
    /// scores of every scene at every step, and those of the scenes alone.
    fn together_and_alone(device: &Device) -> [Vec<Vec<f32>>; 2] {
        let config = config();
        let network = Smart::init(&config, &mut Initializer::new(5, device)).unwrap();
        let tables =
            network.tables(&token_shapes(&config, &mut ChaCha8Rng::seed_from_u64(1)), device).unwrap();
        // The last scene has no map.
        let scenes = [(7, 5, 21), (8, 9, 40), (9, 2, 7), (10, 4, 0)].map(|(s, a, p)| scene(s, a, p));
        let steps = [0..STEPS, 0..STEPS, 0..3, 2..STEPS];
        let maps = network.encode_maps(&tables, &scenes.each_ref().map(|(map, ..)| map));
        let begun = maps.into_iter().zip(scenes.iter().map(|(_, agents, _)| agents.clone())).collect();
        let mut cached = network.begin_all(&tables, begun);
        let [mut together, mut alone] = [(); 2].map(|()| vec![Vec::new(); scenes.len()]);
        for t in 0..STEPS {
            let running: Vec<usize> = (0..scenes.len()).filter(|i| steps[*i].contains(&t)).collect();
            let group = cached.iter_mut().enumerate().filter(|(i, _)| running.contains(i));
            let group = group.map(|(i, scene)| (scene, scenes[i].2[t].clone())).collect();
            let scores = network.step_all(&tables, group);
            let width = scores.dims()[1];
            let scores: Vec<f32> = scores.into_data().iter::<f32>().collect();
            let mut rest = scores.as_slice();
            for i in running {
                let (own, others) = rest.split_at(scenes[i].1.len() * width);
                together[i].extend_from_slice(own);
                rest = others;
            }
            assert!(rest.is_empty());
        }
        for (i, (map, agents, all)) in scenes.iter().enumerate() {
            let map = network.encode_map(&tables, map).unwrap();
            let mut scene = network.begin(&tables, map, agents.clone()).unwrap();
            for step in &all[steps[i].clone()] {
                let scores = network.step(&tables, &mut scene, step.clone()).unwrap();
                alone[i].extend(scores.into_data().iter::<f32>());
            }
        }
        [together, alone]
    }

    #[test]
    fn scenes_together_have_the_scores_of_scenes_alone() {
        let [host, _] = together_and_alone(&device());
        for device in [device(), device().autodiff()] {
            let [together, alone] = together_and_alone(&device);
            for (i, ((together, alone), host)) in together.iter().zip(&alone).zip(&host).enumerate() {
                assert_eq!((together.len(), alone.len()), (host.len(), host.len()));
                for ((a, b), c) in together.iter().zip(alone).zip(host) {
                    assert!((a - b).abs() < 1e-5 && (a - c).abs() < 1e-5, "scene {i}: {a} {b} {c}");
                }
            }
        }
    }

    #[test]
    fn a_scene_of_any_length_keeps_the_steps_of_its_window() {
        let (config, device) = (config(), device());
        assert_eq!(config.window(), 3);
        let endless = SmartConfig { time_span: 1 << 40, ..config.clone() };
        assert_eq!(endless.window(), TOKEN_STEPS, "no more than in training");
        let network = Smart::init(&config, &mut Initializer::new(5, &device)).unwrap();
        let shapes = token_shapes(&config, &mut ChaCha8Rng::seed_from_u64(1));
        let tables = network.tables(&shapes, &device).unwrap();
        let (map, agents, steps) = scene(7, 5, 21);
        let map = network.encode_map(&tables, &map).unwrap();
        let mut scene = network.begin(&tables, map, agents).unwrap();
        for step in steps.iter().cycle().take(100) {
            let features = network.advance(&tables, &mut scene, step.clone()).unwrap();
            assert!(features.into_data().iter::<f32>().all(f32::is_finite));
            assert!(scene.steps.len() <= 3 && scene.pasts.len() == scene.steps.len());
        }
    }
}
