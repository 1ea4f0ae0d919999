//! Ids of mixed traffic, such as `mix:idm=0.5+ntp-guarded=0.5+pedestrian=constant-velocity`.

use std::fmt;

use reactsim_models::MODELS;
use reactsim_qp::Smoothing;
use reactsim_scene::AgentKind;

use crate::error::EvaluationError;
use crate::simulators::id::SimulatorId;

/// Begins the id of a mix.
const PREFIX: &str = "mix:";
/// Separates the parts of a mix.
const SEPARATOR: char = '+';
/// Classes of agents of which one simulator may move all.
const CLASSES: [AgentKind; 2] = [AgentKind::Pedestrian, AgentKind::Cyclist];

/// A mix of simulators, as its id states it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MixId {
    /// Simulators and their shares above 0, in the order of the baselines, then by id.
    pub shares: Vec<(String, f64)>,
    /// Classes of agents with a simulator of their own, in the order of [`CLASSES`].
    pub classes: Vec<(AgentKind, String)>,
    /// Stage behind the mix.
    pub smoothing: Option<Smoothing>,
}

impl MixId {
    /// Parses an id; `None` if it is not that of a mix. Parts are separated by `+` or commas. Whether the
    /// simulators exist is not checked.
    ///
    /// # Errors
    /// [`EvaluationError`] names the part that is refused.
    pub(crate) fn parse(id: &str) -> Result<Option<Self>, EvaluationError> {
        let Some(text) = id.strip_prefix(PREFIX) else { return Ok(None) };
        let refuse = |reason: String| EvaluationError::Refused(format!("`{id}`: {reason}"));
        let text = text.replace(',', "+");
        let (text, smoothing) = match Smoothing::of_id(&text) {
            Some((text, smoothing)) => (text, Some(smoothing)),
            None => (text.as_str(), None),
        };
        let mut mix = Self { shares: Vec::new(), classes: Vec::new(), smoothing };
        let mut name = String::new();
        for part in text.split(SEPARATOR) {
            name.push_str(part);
            let Some((end, value)) = part.rsplit_once('=') else {
                // The stage of a member, as in `idm+qp=0.5`, comes before its share.
                name.push(SEPARATOR);
                continue;
            };
            name.truncate(name.len() - part.len() + end.len());
            mix.add(std::mem::take(&mut name).trim(), value.trim()).map_err(refuse)?;
        }
        if !name.is_empty() {
            let part = name.trim_end_matches(SEPARATOR);
            return Err(refuse(format!("`{part}` has no share: write NAME=SHARE, such as idm=0.5")));
        }
        let total = mix.shares.iter().fold(0.0, |sum, (_, share)| sum + share);
        if !(total.is_finite() && total > 0.0) {
            return Err(refuse(format!(
                "the sum of the shares is {total}, expected a finite number above 0"
            )));
        }
        mix.shares.retain(|(_, share)| *share > 0.0);
        let place = |id: &str| {
            let baseline = SimulatorId::parse(id).map(|id| id.baseline);
            MODELS.iter().position(|model| baseline.as_ref().is_ok_and(|baseline| *baseline == model.id))
        };
        mix.shares.sort_by(|(a, _), (b, _)| (place(a), a).cmp(&(place(b), b)));
        mix.classes.sort_by_key(|(kind, _)| *kind);
        Ok(Some(mix))
    }

    /// Adds a part; the error is the reason why it is refused.
    fn add(&mut self, name: &str, value: &str) -> Result<(), String> {
        let twice = || Err(format!("`{name}` is named twice"));
        if [name, value].iter().any(|id| id.contains(PREFIX)) {
            return Err("a mix cannot be part of a mix: name its simulators".to_owned());
        }
        if let Some(kind) = CLASSES.into_iter().find(|kind| kind.name() == name) {
            if value.parse::<f64>().is_ok() || value.is_empty() {
                return Err(format!("`{name}={value}`: name the simulator of the class, such as {name}=idm"));
            }
            if self.classes.iter().any(|(other, _)| *other == kind) {
                return twice();
            }
            self.classes.push((kind, value.to_owned()));
            return Ok(());
        }
        let share = value.parse::<f64>().ok().filter(|share| share.is_finite() && *share >= 0.0);
        let Some(share) = share else {
            return Err(format!(
                "the share of `{name}` is `{value}`, expected a finite number of at least 0, as in idm=0.5; \
                 only pedestrian and cyclist take the name of a simulator"
            ));
        };
        if self.shares.iter().any(|(other, _)| other == name) {
            return twice();
        }
        self.shares.push((name.to_owned(), share));
        Ok(())
    }

    /// Returns the ids of its simulators, each once: those with a share, then those of classes only.
    pub(crate) fn members(&self) -> Vec<&str> {
        let mut members: Vec<&str> = self.shares.iter().map(|(id, _)| id.as_str()).collect();
        for (_, id) in &self.classes {
            if !members.contains(&id.as_str()) {
                members.push(id);
            }
        }
        members
    }

    /// Returns its name in tables, without the stage; `title` returns that of a simulator.
    pub(crate) fn title<'a>(&self, title: impl Fn(&str) -> &'a str) -> String {
        let share = |(id, share): &(String, f64)| format!("{} {share}", title(id));
        let class = |(kind, id): &(AgentKind, String)| format!("{kind}s {}", title(id));
        let parts: Vec<String> =
            self.shares.iter().map(share).chain(self.classes.iter().map(class)).collect();
        format!("Mix ({})", parts.join(", "))
    }
}

impl fmt::Display for MixId {
    /// Writes the canonical id: members in order, shares as the shortest numbers that are equal to the given
    /// ones. They remain relative to each other.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shares = self.shares.iter().map(|(id, share)| format!("{id}={share}"));
        let classes = self.classes.iter().map(|(kind, id)| format!("{kind}={id}"));
        let parts: Vec<String> = shares.chain(classes).collect();
        let id = format!("{PREFIX}{}", parts.join("+"));
        match self.smoothing {
            Some(smoothing) => f.write_str(&smoothing.id(&id)),
            None => f.write_str(&id),
        }
    }
}

/// Returns ids from a list that was separated at its commas: a part such as `idm=0.5` belongs to the mix
/// before it.
pub(crate) fn joined(ids: &[String]) -> Vec<String> {
    let mut joined: Vec<String> = Vec::new();
    for id in ids {
        match joined.last_mut() {
            Some(mix) if mix.starts_with(PREFIX) && id.contains('=') && !id.starts_with(PREFIX) => {
                mix.push(SEPARATOR);
                mix.push_str(id);
            }
            _ => joined.push(id.clone()),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canonical(id: &str) -> String {
        MixId::parse(id).unwrap().unwrap().to_string()
    }

    #[test]
    fn ids_are_canonical() {
        for (given, expected) in [
            ("mix:idm=1", "mix:idm=1"),
            ("mix:idm=0.50+constant-velocity=.5", "mix:constant-velocity=0.5+idm=0.5"),
            ("mix:ntp-guarded=0.3,idm=0.5,constant-velocity=0", "mix:idm=0.5+ntp-guarded=0.3"),
            ("mix: idm = 1 , stop = 2", "mix:stop=2+idm=1"),
            ("mix:idm@b=1+idm@a=2+idm@styles=3+idm=4", "mix:idm=4+idm@a=2+idm@b=1+idm@styles=3"),
            ("mix:stop=1+idm+qp=1e-3", "mix:stop=1+idm+qp=0.001"),
            ("mix:cyclist=idm+pedestrian=stop+idm=2+qp", "mix:idm=2+pedestrian=stop+cyclist=idm+qp"),
        ] {
            assert_eq!(canonical(given), expected, "{given}");
            assert_eq!(canonical(expected), expected);
        }
        assert_eq!(MixId::parse("idm+qp").unwrap(), None);
        let mix = MixId::parse("mix:idm=1+pedestrian=stop+cyclist=idm").unwrap().unwrap();
        assert_eq!(mix.members(), ["idm", "stop"]);
        let title = |id: &str| if id == "idm" { "IDM" } else { "Stop" };
        assert_eq!(mix.title(title), "Mix (IDM 1, pedestrians Stop, cyclists IDM)");
    }

    #[test]
    fn invalid_mixes_are_refused_by_the_part() {
        for (id, part) in [
            ("mix:", "`` has no share"),
            ("mix:idm", "`idm` has no share: write NAME=SHARE"),
            ("mix:idm=1+stop", "`stop` has no share"),
            ("mix:idm=", "the share of `idm` is ``"),
            ("mix:idm=-0.5+stop=1", "the share of `idm` is `-0.5`"),
            ("mix:idm=inf", "the share of `idm` is `inf`"),
            ("mix:idm=nan", "the share of `idm` is `nan`"),
            ("mix:idm=half", "the share of `idm` is `half`"),
            ("mix:pedestrians=idm", "only pedestrian and cyclist take the name of a simulator"),
            ("mix:idm=1e308+stop=1e308", "the sum of the shares is inf"),
            ("mix:idm=0+stop=0", "the sum of the shares is 0"),
            ("mix:pedestrian=stop", "the sum of the shares is 0"),
            ("mix:idm=1+idm=2", "`idm` is named twice"),
            ("mix:idm=1+pedestrian=idm+pedestrian=stop", "`pedestrian` is named twice"),
            ("mix:idm=1+pedestrian=0.5", "`pedestrian=0.5`: name the simulator of the class"),
            ("mix:mix:idm=1=0.5", "a mix cannot be part of a mix"),
            ("mix:idm=1+pedestrian=mix:stop=1", "a mix cannot be part of a mix"),
        ] {
            let error = MixId::parse(id).unwrap_err().to_string();
            assert!(error.contains(part) && error.contains(id), "{error}");
        }
    }

    #[test]
    fn parts_of_a_list_join_their_mix() {
        let given = ["stop", "mix:idm=1", "stop=2", "idm", "mix:idm=1", "mix:idm=2", "pedestrian=stop"];
        let expected = ["stop", "mix:idm=1+stop=2", "idm", "mix:idm=1", "mix:idm=2+pedestrian=stop"];
        assert_eq!(joined(&given.map(str::to_owned)), expected);
    }
}
