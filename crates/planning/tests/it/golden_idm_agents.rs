//! Agreement of reactive agents with nuPlan's devkit, whatever moves ego. Where the shared data is missing, the
//! test is skipped with a message.

use std::collections::BTreeMap;
use std::sync::Arc;

use reactsim_planning::idm_agents::{IdmAgent, IdmAgents, Lead, Leader, SeenEgo, Step, seen};
use reactsim_planning::{EgoState, PlanningMap, TrackedObject};

use crate::document::states;
use crate::part::{Largest, Part, documents};

const TOLERANCE: f64 = 1e-9;

#[test]
fn agents_agree_with_the_devkit() {
    for document in documents("idm_agents") {
        let expected = document.at("expected");
        Comparison::new(&document, &expected, &expected.at("agents")).run();
    }
}

#[test]
fn agents_around_planners_agree_with_the_devkit() {
    for document in documents("loop15_reactive") {
        let expected = document.at("agents");
        Comparison::new(&document, &expected, &expected.at("states")).run();
    }
}

/// The agents of a document, with the recorded ego.
struct Comparison<'a> {
    document: &'a Part,
    map: PlanningMap,
    ego: Vec<EgoState>,
    order: Vec<String>,
    /// Expected values per agent.
    states: BTreeMap<String, Series>,
    leads: Part,
    present: Vec<Part>,
    agents: IdmAgents,
    largest: Largest,
}

/// Expected states of an agent per sample: x, y, heading, vx, vy, v; infinite after its removal.
type Series = [Vec<f64>; 6];

impl<'a> Comparison<'a> {
    fn new(document: &'a Part, expected: &Part, states_of: &Part) -> Self {
        let order = expected.texts("order");
        let series = |id: &String| {
            let agent = states_of.at(id);
            ["x", "y", "heading", "vx", "vy", "v"].map(|name| agent.numbers(name))
        };
        let ego = states(&document.json("ego"), document.number("dt"));
        let seen_ego = SeenEgo::new(&ego[0], &document.shape());
        let agents = IdmAgents::new(
            Arc::new(document.agent_roads()),
            document.agent_parameters(),
            &document.objects(0),
            Some(&seen_ego),
        );
        Self {
            document,
            map: document.map(),
            ego,
            states: order.iter().map(|id| (id.clone(), series(id))).collect(),
            order,
            leads: expected.at("leads"),
            present: expected.at("present").list(),
            agents,
            largest: Largest::new(TOLERANCE),
        }
    }

    fn run(mut self) {
        let names: Vec<&str> = self.agents.agents().iter().map(|agent| &**agent.id()).collect();
        assert_eq!(names, self.order, "{}: order", self.document.place());
        self.compare_sample(0, &self.document.objects(0));
        let shape = self.document.shape();
        for sample in 1..self.ego.len() {
            let ego = SeenEgo::new(&self.ego[sample - 1], &shape);
            let objects = self.document.objects(sample);
            let lights = self.document.lights(&self.map, sample);
            let step =
                Step { center: ego.footprint.center, ego: Some(ego), objects: &objects, lights: &lights };
            self.agents.step(&step);
            self.compare_sample(sample, &objects);
            self.compare_leads(sample - 1);
        }
        self.largest.check(self.document.place());
    }

    /// Compares who is present at a sample, and the states of the agents.
    fn compare_sample(&mut self, sample: usize, objects: &[TrackedObject]) {
        let place = self.document.place();
        let present = self.agents.agents().iter().map(|agent| agent.id().to_string());
        let present: Vec<String> = present.chain(seen(objects).map(|object| object.id.to_string())).collect();
        let expected: Vec<String> = self.present[sample].list().iter().map(Part::string).collect();
        assert_eq!(present, expected, "{place}: present[{sample}]");
        for (id, series) in &self.states {
            let found = self.agents.agents().iter().find(|agent| &**agent.id() == id);
            assert_eq!(found.is_some(), series[0][sample].is_finite(), "{place}: {id}[{sample}]");
            let Some(agent) = found else { continue };
            let object = agent.object();
            let (center, velocity) = (object.center, object.velocity);
            let values = [center.x, center.y, object.heading, velocity.x, velocity.y, agent.speed()];
            for (i, value) in values.into_iter().enumerate() {
                self.largest.compare(value, series[i][sample], || format!("{id}[{sample}], value {i}"));
            }
        }
    }

    /// Compares what the agents followed in a step, and their paths after it. Documents with a planner have the
    /// names of the leaders only.
    fn compare_leads(&mut self, step: usize) {
        for agent in self.agents.agents() {
            let (id, place) = (agent.id(), format!("{}: {}[{step}]", self.document.place(), agent.id()));
            let expected = self.leads.at(id);
            let has_paths = expected.has("lead");
            let Some(lead) = agent.lead() else { panic!("{place}: no lead") };
            let names = if has_paths { expected.at("lead") } else { expected.clone() };
            assert_eq!(name(lead).as_deref(), names.list()[step].text(), "{place}: lead");
            if !has_paths {
                continue;
            }
            let route: Vec<&str> =
                agent.route().iter().map(|&lane| self.map.lane(lane).id.as_str()).collect();
            assert_eq!(route, route_at(&expected.at("routes"), step), "{place}: route");
            for (name, value) in values(agent, lead) {
                let expected = expected.at(name).list()[step].float();
                self.largest.compare(value, expected, || format!("{id}[{step}], {name}"));
            }
        }
    }
}

fn values(agent: &IdmAgent, lead: &Lead) -> [(&'static str, f64); 6] {
    [
        ("distance", lead.distance),
        ("lead_velocity", lead.speed),
        ("length_rear", lead.rear),
        ("target_velocity", agent.target_speed()),
        ("progress", agent.progress()),
        ("path_end", agent.path_end()),
    ]
}

/// Returns the name of a leader in the documents.
fn name(lead: &Lead) -> Option<String> {
    match &lead.leader {
        Leader::PathEnd => None,
        Leader::Ego => Some("ego".to_owned()),
        Leader::Agent(id) | Leader::Object(id) => Some(id.to_string()),
        Leader::StopLine(id) => Some(format!("stop_line_{id}")),
    }
}

/// Returns the route in a step: the last one at which it changed.
fn route_at(routes: &Part, step: usize) -> Vec<String> {
    let changes = routes.list();
    let at = |change: &Part| change.list()[0].float() as usize;
    let last = changes.iter().rev().find(|change| at(change) <= step).unwrap();
    last.list()[1].list().iter().map(Part::string).collect()
}
