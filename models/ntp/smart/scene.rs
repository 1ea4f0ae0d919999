//! Network input: plain lists, validated before any computation.

use reactsim_nn::perception::Class;
use reactsim_scene::Agent;
use reactsim_scene::dynamics::Pose;

use super::SmartConfig;

/// The map as P pieces of 5 m. All lists have one entry per piece.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapTokens {
    /// Start of the piece, m.
    pub position: Vec<[f32; 2]>,
    /// Heading of its first half metre, rad.
    pub orientation: Vec<f32>,
    /// Index of the most similar curve of the vocabulary.
    pub token: Vec<u32>,
    /// 0 freeway, 1 surface street, 2 lane with stop sign, 3 bike lane, 4 road edge boundary, 5 road
    /// edge median, 6 broken line, 7 solid single line, 8 double line, 9 crosswalk, speed bump or
    /// driveway.
    pub kind: Vec<u8>,
    /// 0 lane, 1 road edge, 2 road line, 3 crosswalk.
    pub polygon: Vec<u8>,
    /// 0 no light, 1 unknown, 2 stop, 3 go, 4 caution.
    pub light: Vec<u8>,
}

/// The A agents of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Agents {
    /// 0 vehicle, 1 pedestrian, 2 cyclist.
    pub class: Vec<u8>,
    /// Length, width, height, m.
    pub shape: Vec<[f32; 3]>,
}

/// Poses of all agents at one step (every 0.5 s). All lists have one entry per agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// Box centre, m. The published networks were trained with 0, 0 for invalid steps.
    pub position: Vec<[f32; 2]>,
    /// Heading, rad.
    pub heading: Vec<f32>,
    /// Whether the agent was present at this step and the one before.
    pub valid: Vec<bool>,
    /// Token of the agent's class that led here; any valid index if the step is invalid.
    pub token: Vec<u32>,
}

/// Map, agents and their steps, oldest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Map.
    pub map: MapTokens,
    /// Agents.
    pub agents: Agents,
    /// Steps of the agents.
    pub steps: Vec<Step>,
}

/// Reason why network input is rejected: the list and the entry.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct InputError(pub(super) String);

fn length<T>(field: &'static str, list: &[T], expected: usize) -> Result<(), InputError> {
    if list.len() == expected {
        Ok(())
    } else {
        let found = list.len();
        Err(InputError(format!(
            "`{field}` has {found} entries, expected {expected}: one per entry of the other lists"
        )))
    }
}

fn below(field: &'static str, numbers: impl Iterator<Item = (usize, usize)>) -> Result<(), InputError> {
    for (index, (found, below)) in numbers.enumerate() {
        if found >= below {
            let text = format!("`{field}` {index} is {found}, expected a number below {below}");
            return Err(InputError(text));
        }
    }
    Ok(())
}

fn finite<const D: usize>(
    field: &'static str,
    rows: impl Iterator<Item = [f32; D]>,
) -> Result<(), InputError> {
    for (index, row) in rows.enumerate() {
        if !row.iter().all(|v| v.is_finite()) {
            return Err(InputError(format!("`{field}` {index} is not finite")));
        }
    }
    Ok(())
}

impl MapTokens {
    /// Returns the number of pieces.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Returns whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Checks the input for a network with this configuration.
    ///
    /// # Errors
    /// [`InputError`] naming the list and entry.
    pub fn check(&self, config: &SmartConfig) -> Result<(), InputError> {
        length("map.orientation", &self.orientation, self.len())?;
        length("map.token", &self.token, self.len())?;
        finite("map.position", self.position.iter().copied())?;
        finite("map.orientation", self.orientation.iter().map(|o| [*o]))?;
        below("map.token", self.token.iter().map(|t| (*t as usize, config.n_token_map)))?;
        for (field, list, limit) in [
            ("map.kind", &self.kind, config.map_point_types),
            ("map.polygon", &self.polygon, config.map_polygon_types),
            ("map.light", &self.light, config.map_light_types),
        ] {
            length(field, list, self.len())?;
            below(field, list.iter().map(|v| (usize::from(*v), limit)))?;
        }
        Ok(())
    }

    /// Keeps only the marked pieces.
    pub(super) fn retain(&mut self, kept: &[bool]) {
        fn of<T: Copy>(list: &mut Vec<T>, kept: &[bool]) {
            *list = list.iter().zip(kept).filter(|(_, kept)| **kept).map(|(value, _)| *value).collect();
        }
        of(&mut self.position, kept);
        of(&mut self.orientation, kept);
        of(&mut self.token, kept);
        of(&mut self.kind, kept);
        of(&mut self.polygon, kept);
        of(&mut self.light, kept);
    }

    /// Appends the pieces of another map.
    pub(super) fn append(&mut self, other: &Self) {
        self.position.extend_from_slice(&other.position);
        self.orientation.extend_from_slice(&other.orientation);
        self.token.extend_from_slice(&other.token);
        self.kind.extend_from_slice(&other.kind);
        self.polygon.extend_from_slice(&other.polygon);
        self.light.extend_from_slice(&other.light);
    }
}

impl Agents {
    /// Adds an agent. Boxes have no height here: all get `height`, in metres.
    pub(super) fn push(&mut self, class: Class, agent: &Agent, height: f64) {
        self.class.push(class.index() as u8);
        self.shape.push([agent.length as f32, agent.width as f32, height as f32]);
    }

    /// Appends the agents of another scene.
    pub(super) fn append(&mut self, other: &Self) {
        self.class.extend_from_slice(&other.class);
        self.shape.extend_from_slice(&other.shape);
    }

    /// Returns the number of agents.
    pub fn len(&self) -> usize {
        self.class.len()
    }

    /// Returns whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.class.is_empty()
    }

    /// Checks the agents.
    ///
    /// # Errors
    /// [`InputError`] naming the list and entry.
    pub fn check(&self) -> Result<(), InputError> {
        length("agents.shape", &self.shape, self.len())?;
        below("agents.class", self.class.iter().map(|c| (usize::from(*c), 3)))?;
        finite("agents.shape", self.shape.iter().copied())
    }
}

impl Step {
    /// Adds the pose of an agent and the token that led there.
    pub(super) fn push(&mut self, pose: Pose, token: usize, valid: bool) {
        self.position.push([pose.position.x as f32, pose.position.y as f32]);
        self.heading.push(pose.heading as f32);
        self.valid.push(valid);
        self.token.push(token as u32);
    }

    /// Checks the step for these agents and a network with this configuration.
    ///
    /// # Errors
    /// [`InputError`] naming the list and entry.
    pub fn check(&self, config: &SmartConfig, agents: &Agents) -> Result<(), InputError> {
        length("step.position", &self.position, agents.len())?;
        length("step.heading", &self.heading, agents.len())?;
        length("step.valid", &self.valid, agents.len())?;
        length("step.token", &self.token, agents.len())?;
        finite("step.position", self.position.iter().copied())?;
        finite("step.heading", self.heading.iter().map(|h| [*h]))?;
        let counts = config.n_token_agent.of_classes();
        let tokens = self.token.iter().zip(&agents.class);
        below("step.token", tokens.map(|(t, c)| (*t as usize, counts[usize::from(*c)])))
    }
}

impl Scene {
    /// Checks the input for a network with this configuration.
    ///
    /// # Errors
    /// [`InputError`] naming the list and entry.
    pub fn check(&self, config: &SmartConfig) -> Result<(), InputError> {
        self.map.check(config)?;
        self.agents.check()?;
        self.steps.iter().try_for_each(|step| step.check(config, &self.agents))
    }
}
