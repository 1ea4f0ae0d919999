//! Textual description of a scenario.

use crate::scene::{AgentKind, Certificate, DT, Difficulty, LaneKind, Length, Response, Scenario, note_text};

/// Describes a scenario: pairs of a property and its text.
pub(super) fn describe(scenario: &Scenario) -> Vec<(&'static str, String)> {
    let (start, map) = (&scenario.start, &scenario.start.map);
    let kinds = |agents: &mut dyn Iterator<Item = AgentKind>| {
        let all: Vec<AgentKind> = agents.collect();
        let of = |kind: AgentKind| {
            let n = all.iter().filter(|k| **k == kind).count();
            (n > 0).then(|| format!("{n} {kind}{}", if n == 1 { "" } else { "s" }))
        };
        let parts: Vec<String> = AgentKind::ALL.into_iter().filter_map(of).collect();
        if parts.is_empty() { "none".to_owned() } else { parts.join(", ") }
    };
    let world = start.agents.len().saturating_sub(1);
    let lanes = |kind: LaneKind| map.lanes.iter().filter(|l| l.kind == kind).count();
    // A sum of no numbers is -0.
    let metres = map.lanes.iter().fold(0.0, |sum, lane| sum + lane.baseline.length());
    let seen =
        (0..start.lights.len()).filter(|&i| scenario.light_states(i).iter().any(Option::is_some)).count();
    let mut lines = vec![
        ("scenario", scenario.id.clone()),
        ("source", scenario.source.clone()),
        ("digest", scenario.digest()),
        ("origin", format!("({:.3}, {:.3}) m in the world", scenario.origin.x, scenario.origin.y)),
        (
            "agents",
            format!("{world} around the AV: {}", kinds(&mut start.agents[1..].iter().map(|a| a.kind))),
        ),
        ("context", kinds(&mut scenario.unselected.iter().map(|a| a.agent.kind))),
        (
            "lanes",
            format!(
                "{} lanes, {} connectors, {metres:.0} m",
                lanes(LaneKind::Lane),
                lanes(LaneKind::Connector)
            ),
        ),
        (
            "map",
            format!(
                "{} road edges, {} road lines, {} stop lines, {} crosswalks, {} speed bumps, {} driveways",
                map.road_edges.len(),
                map.road_lines.len(),
                map.stop_lines.len(),
                map.crosswalks.len(),
                map.speed_bumps.len(),
                map.driveways.len()
            ),
        ),
        (
            "drivable area",
            match &map.drivable_area {
                Some(area) => format!("{} polygon{}", area.len(), if area.len() == 1 { "" } else { "s" }),
                None if map.road_edges.is_empty() => "none".to_owned(),
                None => "by road edges".to_owned(),
            },
        ),
        ("lights", format!("{}, {seen} of them observed", start.lights.len())),
        ("AV", travel(scenario)),
        (
            "deviation",
            scenario.deviation.as_ref().map_or("none".into(), |d| {
                let category = d.category.map_or("of unknown category", |c| c.name());
                let end = d.track.last().map(|s| s.position());
                let logged = scenario.log_future.tracks[0].last().copied().flatten().map(|s| s.position());
                match end.zip(logged) {
                    Some((end, logged)) => {
                        format!("{category}, {:.1} m off at the end", (end - logged).norm())
                    }
                    None => category.to_owned(),
                }
            }),
        ),
    ];
    let length = scenario.length();
    if length != Length::BENCHMARK {
        lines.push((
            "length",
            format!("{length}, {:.1} s after the current frame", length.future as f64 * DT),
        ));
    }
    if start.has_levels() {
        lines.push(("levels", format!("up to {} above one another", scenario.levels())));
    }
    if let Some(certificate) = scenario.deviation.as_ref().and_then(|d| d.certificate.as_ref()) {
        lines.push(("certificate", effort(certificate)));
        lines.extend(certificate.responses.iter().map(|r| ("", response(r))));
    }
    for (what, n) in &scenario.repairs {
        lines.push(("left out", format!("{n} {what}")));
    }
    for (id, note) in scenario.notes() {
        let detail = note.detail.as_ref().map(|detail| format!(": {detail}")).unwrap_or_default();
        lines.push(("note", note_text(id, note.count.into()) + &detail));
    }
    lines
}

/// Describes the effort with which all agents can avoid the AV.
fn effort(certificate: &Certificate) -> String {
    let measured = |difficulty: Difficulty| {
        let time = certificate.time_to_react().map_or(String::new(), |t| format!(", {t:.1} s to react"));
        let braking = certificate.required_deceleration().unwrap_or(0.0);
        let swerve = if certificate.needs_swerve() { ", a swerve" } else { "" };
        format!("{difficulty}: braking with {braking:.1} m/s² is enough to avoid the AV{time}{swerve}")
    };
    certificate
        .difficulty()
        .map_or("the AV can be avoided; how hard that is was not measured".into(), measured)
}

/// Describes one certified response.
fn response(response: &Response) -> String {
    let Response { agent, leader, peak_deceleration, nudge, clearance, .. } = response;
    let whom = leader.as_ref().map_or("the AV".to_owned(), |leader| format!("`{leader}`"));
    let aside = match nudge {
        0.0 => String::new(),
        n => format!(", {:.1} m to the {}", n.abs(), if *n > 0.0 { "left" } else { "right" }),
    };
    format!(
        "`{agent}` answers {whom}, for example by braking with up to {peak_deceleration:.1} m/s²{aside}, \
         {clearance:.1} m clear of the AV"
    )
}

/// Describes the logged AV: its size, current speed and distance driven.
fn travel(scenario: &Scenario) -> String {
    let (track, length) = (scenario.logged(0), scenario.length());
    let pairs = track[length.current()..].windows(2).filter_map(|w| Some((w[0]?, w[1]?)));
    let metres = pairs.fold(0.0, |sum, (a, b)| sum + (b.position() - a.position()).norm());
    let (steps, all) = (track[length.history..].iter().flatten().count(), length.future);
    let now = scenario.start.now(0);
    let agent = &scenario.start.agents[0];
    let gaps = if steps < all { format!(", present at {steps} of {all} steps") } else { String::new() };
    let speed =
        if now.speed().is_finite() { format!("{:.1} m/s now", now.speed()) } else { "speed unknown".into() };
    let drives = if steps == 0 { String::new() } else { format!(", drives {metres:.1} m") };
    format!("`{}`, {:.2} m x {:.2} m, {speed}{drives}{gaps}", agent.id, agent.length, agent.width)
}
