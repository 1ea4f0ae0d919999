//! What an adaptation changed in scenarios that were not learned from.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::choice::HASTE;
use super::model::AdaptableModel;
use crate::evaluation::{Comparison, PairedDifference, Verdict};
use crate::report::comparison;

/// Metrics that a larger haste improves; a smaller one improves the others.
const IMPROVED_BY_HASTE: [&str; 2] = ["progress", "over-reaction"];

/// The network before (first) and after (second) an adaptation.
pub(super) struct Judgement<'a> {
    pub(super) model: &'a AdaptableModel,
    /// Haste with which the network ran.
    pub(super) haste: Option<&'a str>,
    /// Time that the adaptation had, minutes.
    pub(super) minutes: f64,
    /// Comparisons by name of the protocol, with the metrics of the table.
    pub(super) protocols: Vec<(&'static str, Comparison)>,
}

impl Judgement<'_> {
    /// Returns the verdict: worse if a column is worse in either protocol, else better if a column is better.
    pub(super) fn verdict(&self) -> Verdict {
        let has = |verdict: &Verdict| self.with(*verdict).next().is_some();
        [Verdict::Worse, Verdict::Better].into_iter().find(has).unwrap_or(Verdict::NoDifferenceSeen)
    }

    /// Returns the metrics with a verdict, with the names of the protocols.
    fn with(&self, verdict: Verdict) -> impl Iterator<Item = (&'static str, &PairedDifference)> {
        let all = self.protocols.iter().flat_map(|(name, found)| found.metrics.values().map(|p| (*name, p)));
        all.filter(move |(_, paired)| paired.verdict == verdict)
    }

    /// Returns the verdict in words, with what led to it and what to do.
    pub(super) fn text(&self) -> String {
        let changes = |verdict| {
            let change = |(name, paired)| format!("{} in the {name} protocol", comparison::change(paired));
            self.with(verdict).map(change).collect::<Vec<_>>().join(", ")
        };
        let id = self.model.id;
        match self.verdict() {
            Verdict::Worse => {
                let worse = changes(Verdict::Worse);
                format!("not adapted, worse: {worse}; keep `{id}`, or try {}", self.remedy())
            }
            Verdict::Better => format!("adapted, better: {}; no column is worse", changes(Verdict::Better)),
            Verdict::NoDifferenceSeen => {
                format!("no difference seen in any column; keep `{id}`, or try {}", self.longer())
            }
        }
    }

    /// Returns the setting that works against what is worse.
    fn remedy(&self) -> String {
        let Some(haste) = self.haste.and_then(|text| text.parse::<u32>().ok()) else { return self.longer() };
        let is_improved = |(_, paired): (_, &PairedDifference)| IMPROVED_BY_HASTE.contains(&paired.metric.id);
        let mut worse = self.with(Verdict::Worse).map(is_improved);
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
        for (name, found) in &self.protocols {
            json[*name] = json!(found);
        }
        json
    }

    /// Writes the verdict and the tables of the differences.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "{}\n", self.text())?;
        for (name, found) in &self.protocols {
            writeln!(out, "Before and after, {name} protocol:\n")?;
            comparison::write_differences(found, ["Before", "After"], out)?;
            writeln!(out)?;
        }
        writeln!(out, "{}\n", comparison::LEGEND)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::evaluation::Estimate;
    use crate::metrics::metric;

    /// A judgement of `ntp-guarded` with these verdicts: metrics that went from 1 to 2 or from 2 to 1.
    fn judgement(haste: Option<&'static str>, metrics: &[(&str, Verdict)]) -> Judgement<'static> {
        let paired = |&(id, verdict): &(&str, Verdict)| {
            let spec = metric(id).unwrap().spec();
            let rises = spec.lower_is_better == (verdict == Verdict::Worse);
            let [first, second] = if rises { [1.0, 2.0] } else { [2.0, 1.0] };
            let p = if verdict == Verdict::NoDifferenceSeen { 0.5 } else { 0.01 };
            let difference = Estimate::of(&[second - first; 8], 0, id);
            let (better, worse, visible) = (Vec::new(), Vec::new(), None);
            let found = PairedDifference {
                metric: spec,
                first,
                second,
                difference,
                p,
                verdict,
                visible,
                better,
                worse,
            };
            (spec.id, found)
        };
        let metrics: BTreeMap<_, _> = metrics.iter().map(paired).collect();
        let [first, second] = ["ntp-guarded", "ntp-guarded@mine"].map(str::to_owned);
        Judgement {
            model: AdaptableModel::find("ntp-guarded").unwrap(),
            haste,
            minutes: 3.0,
            protocols: vec![("reactive", Comparison { first, second, scenarios: 8, unpaired: 0, metrics })],
        }
    }

    #[test]
    fn what_is_worse_decides_and_is_said_first() {
        use Verdict::{Better, NoDifferenceSeen, Worse};
        let of = |haste, metrics: &[_]| {
            let found = judgement(haste, metrics);
            let mut out = Vec::new();
            found.write(&mut out).unwrap();
            let first = String::from_utf8(out).unwrap().lines().next().unwrap().to_owned();
            assert_eq!(found.to_json()["text"], first.as_str());
            (found.verdict(), first)
        };
        let lost = [("ade", Better), ("offroad", NoDifferenceSeen), ("progress", Worse)];
        let (verdict, text) = of(Some("3"), &lost);
        assert_eq!(verdict, Worse);
        assert_eq!(
            text,
            "not adapted, worse: Progress 2.000 → 1.000 (p 0.0100) in the reactive protocol; keep \
             `ntp-guarded`, or try a haste of 4 instead of 3: --set ntp-guarded@mine.haste.weight=4"
        );
        assert_eq!(
            of(Some("3"), &[("ade", Better), ("progress", NoDifferenceSeen)]),
            (
                Better,
                "adapted, better: ADE 2.00 → 1.00 m (p 0.0100) in the reactive protocol; no column is worse"
                    .to_owned()
            )
        );
        let (verdict, text) = of(Some("3"), &[("ade", NoDifferenceSeen)]);
        assert_eq!(verdict, NoDifferenceSeen);
        assert!(text.starts_with("no difference seen in any column; keep `ntp-guarded`"), "{text}");
    }

    #[test]
    fn the_remedy_works_against_what_is_worse() {
        let remedy = |haste, metrics: &[&str]| {
            let worse: Vec<_> = metrics.iter().map(|id| (*id, Verdict::Worse)).collect();
            judgement(haste, &worse).remedy()
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
