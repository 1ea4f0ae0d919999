//! What an adaptation changed in scenarios that were not learned from.

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;
use serde_json::{Value, json};

use super::choice::HASTE;
use super::model::AdaptableModel;
use crate::cli::output::count;
use crate::evaluation::{self, Comparison, PairedDifference};
use crate::metrics::metric;
use crate::report::comparison;

/// Metrics that a larger haste improves; a smaller one improves the others.
const IMPROVED_BY_HASTE: [&str; 2] = ["progress", "over-reaction"];

/// Metrics of safety, each with a rise that must be seen where a doubling is less: so much separates shipped
/// simulators on recordings (one collision in 20 scenarios, half a percent of the agents), and to see less
/// takes thousands of scenarios.
const SAFETY: [(&str, f64); 4] =
    [("aav-collision", 0.05), ("aav-ttc", 0.05), ("aa-collision", 0.005), ("offroad", 0.005)];

/// Scenarios on which the network is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Group {
    /// Logs with AVs that deviate.
    Reactive,
    /// Generated scenarios with AVs that deviate: they tell whether reactions were unlearned, not whether the
    /// network is closer to the logs, and are judged by safety only.
    Generated,
    /// Logs in which the simulator moves the AV.
    Realism,
}

impl Group {
    /// Returns the name in files.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Reactive => "reactive",
            Self::Generated => "generated",
            Self::Realism => "realism",
        }
    }

    /// Returns the group as the place of a change.
    const fn place(self) -> &'static str {
        match self {
            Self::Reactive => "in the reactive protocol",
            Self::Generated => "on generated scenarios",
            Self::Realism => "in the realism protocol",
        }
    }

    /// Returns the numbers of scenarios and independent logs of a comparison on this group.
    fn scenarios(self, found: &Comparison) -> String {
        let groups = found.metrics.values().map(PairedDifference::independent).max().unwrap_or_default();
        let logs = if self == Self::Generated { "log" } else { "recording" };
        format!("{} of {}", count(found.scenarios, "scenario"), count(groups, logs))
    }

    /// Returns whether the network is judged by a metric in this group.
    pub(super) fn has(self, metric: &str) -> bool {
        self != Self::Generated || SAFETY.iter().any(|(id, _)| *id == metric)
    }
}

/// Whether an adaptation is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Verdict {
    /// A column is worse, with p below 0.05.
    Worse,
    /// The logs with AVs that deviate are too few to see a doubling of a metric of safety, or lack what it
    /// needs.
    NotJudged,
    /// A column is better on logs, and none is worse.
    Better,
    /// Any difference may be chance.
    NoDifferenceSeen,
}

/// The network before (first) and after (second) an adaptation.
pub(super) struct Judgement<'a> {
    pub(super) model: &'a AdaptableModel,
    /// Haste with which the network ran.
    pub(super) haste: Option<&'a str>,
    /// Time that the adaptation had, minutes.
    pub(super) minutes: f64,
    /// Comparisons by group, with the metrics by which it is judged.
    pub(super) groups: Vec<(Group, Comparison)>,
}

impl Judgement<'_> {
    /// Returns the verdict.
    pub(super) fn verdict(&self) -> Verdict {
        let has = |verdict| self.with(verdict).next().is_some();
        match () {
            () if has(evaluation::Verdict::Worse) => Verdict::Worse,
            () if self.unseen().is_some() => Verdict::NotJudged,
            () if has(evaluation::Verdict::Better) => Verdict::Better,
            () => Verdict::NoDifferenceSeen,
        }
    }

    /// Returns the metrics with a verdict, with their groups. Generated scenarios do not make an adaptation
    /// better.
    fn with(&self, verdict: evaluation::Verdict) -> impl Iterator<Item = (Group, &PairedDifference)> {
        let all = self.groups.iter().flat_map(|(group, found)| found.metrics.values().map(|p| (*group, p)));
        let is_better = verdict == evaluation::Verdict::Better;
        all.filter(move |(group, paired)| {
            paired.verdict == verdict && !(is_better && *group == Group::Generated)
        })
    }

    /// Returns which doublings the logs with deviated AVs could not show, and which metrics of safety have no
    /// value there, in words; `None` if they could show all.
    fn unseen(&self) -> Option<String> {
        let Some((group, found)) = self.groups.iter().find(|(group, _)| *group == Group::Reactive) else {
            return Some("no AV of the held-out logs could deviate: reactions are not judged".to_owned());
        };
        let hidden: Vec<&str> = safety(found)
            .filter(|(paired, least)| paired.may_hide_doubling(*least))
            .map(|(p, _)| p.metric.title)
            .collect();
        let missing = SAFETY.iter().filter(|(id, _)| !found.metrics.contains_key(id));
        let missing: Vec<&str> = missing.filter_map(|(id, _)| Some(metric(id)?.spec().title)).collect();
        let (scenarios, place) = (group.scenarios(found), group.place());
        let parts = [("cannot see a doubling of", hidden), ("no value of", missing)];
        let parts: Vec<String> = parts
            .iter()
            .filter(|(_, titles)| !titles.is_empty())
            .map(|(text, titles)| format!("{text} {}", titles.join(", ")))
            .collect();
        (!parts.is_empty()).then(|| format!("{} with {scenarios} {place}", parts.join(" and ")))
    }

    /// Returns the verdict in words, with what led to it and what to do.
    pub(super) fn text(&self) -> String {
        let changes = |verdict| {
            let change =
                |(group, paired): (Group, _)| format!("{} {}", comparison::change(paired), group.place());
            self.with(verdict).map(change).collect::<Vec<_>>().join(", ")
        };
        let (id, better) = (self.model.id, changes(evaluation::Verdict::Better));
        match self.verdict() {
            Verdict::Worse => {
                let worse = changes(evaluation::Verdict::Worse);
                format!("not adapted, worse: {worse}; keep `{id}`, or try {}", self.remedy())
            }
            Verdict::NotJudged => {
                let better = if better.is_empty() { better } else { format!("; better: {better}") };
                let unseen = self.unseen().unwrap_or_default();
                format!(
                    "not judged: {unseen}; give more held-out logs (a fifth of all) or more --minutes{better}"
                )
            }
            Verdict::Better => format!("adapted, better: {better}; no column is worse"),
            Verdict::NoDifferenceSeen => {
                format!("no difference seen in any column; keep `{id}`, or try {}", self.longer())
            }
        }
    }

    /// Returns the setting that works against what is worse.
    fn remedy(&self) -> String {
        let Some(haste) = self.haste.and_then(|text| text.parse::<u32>().ok()) else { return self.longer() };
        let is_improved = |(_, paired): (_, &PairedDifference)| IMPROVED_BY_HASTE.contains(&paired.metric.id);
        let mut worse = self.with(evaluation::Verdict::Worse).map(is_improved);
        let Some(first) = worse.next() else { return self.longer() };
        // Both directions are needed, or there is no smaller haste.
        let is_one_direction = worse.all(|other| other == first);
        let other = if first { Some(haste + 1) } else { haste.checked_sub(1) };
        match other.filter(|_| is_one_direction) {
            Some(other) => {
                format!("a haste of {other} instead of {haste}: --set {}@mine.{HASTE}={other}", self.model.id)
            }
            None => self.longer(),
        }
    }

    fn longer(&self) -> String {
        format!("more logs or --minutes {}", 3.0 * self.minutes)
    }

    /// Returns the verdict as it is written to the folder.
    pub(super) fn to_json(&self) -> Value {
        let mut json = json!({ "verdict": self.verdict(), "text": self.text() });
        for (group, found) in &self.groups {
            json[group.name()] = json!(found);
        }
        let of_group = |(group, found): &(Group, Comparison)| {
            let texts =
                safety(found).map(|(paired, least)| (paired.metric.id, comparison::power(paired, least)));
            (group.name(), texts.collect())
        };
        let power: BTreeMap<&str, BTreeMap<&str, String>> = self.groups.iter().map(of_group).collect();
        json["power"] = json!(power);
        json
    }

    /// Writes the verdict, and the tables of the differences with their power.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "{}\n", self.text())?;
        for (group, found) in &self.groups {
            writeln!(out, "Before and after {}, {}:\n", group.place(), group.scenarios(found))?;
            comparison::write_differences(found, ["Before", "After"], out)?;
            writeln!(out, "\nThe power of this, in four of five cases:\n")?;
            for (paired, least) in safety(found) {
                writeln!(out, "- {}", comparison::power(paired, least))?;
            }
            writeln!(out)?;
        }
        writeln!(
            out,
            "{} Scenarios of one recording are resampled, and their signs chosen, together.\n",
            comparison::LEGEND
        )
    }
}

/// Returns the metrics of safety of a comparison, with the rises that must be seen.
fn safety(found: &Comparison) -> impl Iterator<Item = (&PairedDifference, f64)> {
    SAFETY.iter().filter_map(|(id, least)| Some((found.metrics.get(id)?, *least)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::Estimate;
    use crate::evaluation::Verdict::{self as Column, Better, NoDifferenceSeen, Worse};

    /// The difference of a metric in 24 scenarios of 8 recordings.
    fn paired(
        id: &str,
        [first, second]: [f64; 2],
        verdict: Column,
        visible: Option<f64>,
    ) -> PairedDifference {
        PairedDifference {
            metric: metric(id).unwrap().spec(),
            first,
            second,
            groups: Some(8),
            difference: Estimate { scenarios: 24, ..Estimate::of(&[second - first; 8], 0, id) },
            p: if verdict == NoDifferenceSeen { 0.5 } else { 0.01 },
            verdict,
            visible,
            better: Vec::new(),
            worse: Vec::new(),
        }
    }

    /// A metric that went from 1 to 2 or from 2 to 1, for this verdict.
    fn changed(id: &str, verdict: Column) -> PairedDifference {
        let rises = metric(id).unwrap().spec().lower_is_better == (verdict == Worse);
        paired(id, if rises { [1.0, 2.0] } else { [2.0, 1.0] }, verdict, None)
    }

    /// A judgement of `ntp-guarded` by these groups, in which the other metrics of safety are unchanged.
    fn judgement(
        haste: Option<&'static str>,
        groups: impl IntoIterator<Item = (Group, Vec<PairedDifference>)>,
    ) -> Judgement<'static> {
        let safe = |(id, _): (&'static str, _)| (id, paired(id, [0.1; 2], NoDifferenceSeen, Some(0.1)));
        let comparison = |metrics: Vec<PairedDifference>| {
            let [first, second] = ["ntp-guarded", "ntp-guarded@mine"].map(str::to_owned);
            let mut all: BTreeMap<_, _> = SAFETY.map(safe).into();
            all.extend(metrics.into_iter().map(|paired| (paired.metric.id, paired)));
            Comparison { first, second, scenarios: 24, unpaired: 0, metrics: all }
        };
        Judgement {
            model: AdaptableModel::find("ntp-guarded").unwrap(),
            haste,
            minutes: 3.0,
            groups: groups.into_iter().map(|(group, metrics)| (group, comparison(metrics))).collect(),
        }
    }

    /// A judgement by logs with deviated AVs.
    fn by_logs(haste: Option<&'static str>, metrics: &[(&str, Column)]) -> Judgement<'static> {
        let metrics = metrics.iter().map(|(id, verdict)| changed(id, *verdict)).collect();
        judgement(haste, [(Group::Reactive, metrics)])
    }

    /// Returns what is printed, whose first line is the text in the folder.
    fn printed(found: &Judgement<'_>) -> String {
        let mut out = Vec::new();
        found.write(&mut out).unwrap();
        let out = String::from_utf8(out).unwrap();
        assert_eq!(found.to_json()["text"].as_str(), out.lines().next());
        out
    }

    #[test]
    fn what_is_worse_decides_and_is_said_first() {
        let of = |haste, metrics: &[_]| {
            let found = by_logs(haste, metrics);
            (found.verdict(), printed(&found).lines().next().unwrap().to_owned())
        };
        let lost = [("ade", Better), ("offroad", NoDifferenceSeen), ("progress", Worse)];
        let (verdict, text) = of(Some("3"), &lost);
        assert_eq!(verdict, Verdict::Worse);
        assert_eq!(
            text,
            "not adapted, worse: Progress 2.000 → 1.000 (p 0.0100) in the reactive protocol; keep \
             `ntp-guarded`, or try a haste of 4 instead of 3: --set ntp-guarded@mine.haste.weight=4"
        );
        assert_eq!(
            of(Some("3"), &[("ade", Better), ("progress", NoDifferenceSeen)]),
            (
                Verdict::Better,
                "adapted, better: ADE 2.00 → 1.00 m (p 0.0100) in the reactive protocol; no column is worse"
                    .to_owned()
            )
        );
        let (verdict, text) = of(Some("3"), &[("ade", NoDifferenceSeen)]);
        assert_eq!(verdict, Verdict::NoDifferenceSeen);
        assert!(text.starts_with("no difference seen in any column; keep `ntp-guarded`"), "{text}");
    }

    #[test]
    fn what_could_double_unseen_is_not_called_adapted() {
        let collisions = |visible| paired("aav-collision", [0.016, 0.066], NoDifferenceSeen, Some(visible));
        let risky = paired("aav-ttc", [0.082, 0.148], NoDifferenceSeen, Some(0.08));
        let of = |visible| {
            let metrics = vec![collisions(visible), risky.clone(), changed("ade", Better)];
            judgement(None, [(Group::Reactive, metrics)])
        };
        let few = of(0.14);
        assert_eq!(few.verdict(), Verdict::NotJudged);
        assert_eq!(
            few.text(),
            "not judged: cannot see a doubling of A-AV Coll. with 24 scenarios of 8 recordings in the reactive \
             protocol; give more held-out logs (a fifth of all) or more --minutes; better: ADE 2.00 → 1.00 m \
             (p 0.0100) in the reactive protocol"
        );
        let out = printed(&few);
        for line in [
            "Before and after in the reactive protocol, 24 scenarios of 8 recordings:",
            "- A-AV Coll. 0.016: cannot see a doubling, only a rise by 0.140",
            "- A-AV risky 0.082: sees a rise by 0.080, less than a doubling",
        ] {
            assert!(out.lines().any(|found| found == line), "{line} is not in\n{out}");
        }
        assert_eq!(few.to_json()["verdict"], "not-judged");
        assert_eq!(
            few.to_json()["power"]["reactive"]["aav-collision"],
            "A-AV Coll. 0.016: cannot see a doubling, only a rise by 0.140"
        );
        // One more collision in 20 scenarios is seen, which is enough.
        assert_eq!(of(0.05).verdict(), Verdict::Better);
        assert_eq!(of(0.051).verdict(), Verdict::NotJudged);
        // A metric of safety that nothing has a value of is not safe.
        let mut without = of(0.05);
        without.groups[0].1.metrics.remove("offroad");
        assert_eq!(without.verdict(), Verdict::NotJudged);
        let expected = "not judged: no value of Offroad with 24 scenarios of 8 recordings in the reactive";
        assert!(without.text().starts_with(expected), "{}", without.text());
        // What is worse is said whatever else could not be seen.
        let worse = judgement(None, [(Group::Reactive, vec![collisions(0.14), changed("ade", Worse)])]);
        assert_eq!(worse.verdict(), Verdict::Worse);
        // Without AVs that deviate, reactions are not judged.
        let realism = judgement(None, [(Group::Realism, vec![changed("ade", Better)])]);
        assert_eq!(realism.verdict(), Verdict::NotJudged);
        assert!(realism.text().starts_with("not judged: no AV of the held-out logs could deviate"));
    }

    #[test]
    fn generated_scenarios_can_only_make_it_worse() {
        let of = |verdict| {
            let logs = (Group::Reactive, vec![changed("ade", NoDifferenceSeen)]);
            judgement(None, [logs, (Group::Generated, vec![changed("aav-ttc", verdict)])])
        };
        assert_eq!(of(Better).verdict(), Verdict::NoDifferenceSeen);
        assert_eq!(of(Worse).verdict(), Verdict::Worse);
        let text = of(Worse).text();
        assert!(text.contains("A-AV risky 1.000 → 2.000 (p 0.0100) on generated scenarios"), "{text}");
    }

    #[test]
    fn the_remedy_works_against_what_is_worse() {
        let remedy = |haste, metrics: &[&str]| {
            let worse: Vec<_> = metrics.iter().map(|id| (*id, Worse)).collect();
            by_logs(haste, &worse).remedy()
        };
        let haste = |text: &str| text.split_once("haste.weight=").map(|(_, value)| value.to_owned());
        assert_eq!(haste(&remedy(Some("5"), &["progress", "over-reaction"])).as_deref(), Some("6"));
        assert_eq!(haste(&remedy(Some("4"), &["aav-collision", "ade"])).as_deref(), Some("3"));
        // No haste is smaller, helps with both, or there is none to choose.
        let longer = "more logs or --minutes 9";
        assert_eq!(remedy(Some("0"), &["aav-collision"]), longer);
        assert_eq!(remedy(Some("4"), &["aav-collision", "progress"]), longer);
        assert_eq!(remedy(None, &["progress"]), longer);
    }
}
