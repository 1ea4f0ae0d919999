use reactsim_scene::{Agent, AgentKind, AgentState, FRAMES, Length, LoggedAgent, ScenarioParts};

use super::*;

fn agent(id: &str, y: f64, speed: f64) -> LoggedAgent {
    let state = |f: usize| {
        Some(AgentState { x: speed * 0.1 * (f as f64 - 10.0), y, heading: 0.0, vx: speed, vy: 0.0 })
    };
    LoggedAgent {
        agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
        track: (0..FRAMES).map(state).collect(),
        heights: Vec::new(),
    }
}

fn scenario(speed: f64) -> Scenario {
    let agents = vec![agent("ego", 0.0, speed), agent("other", 6.0, 0.0)];
    Scenario::assemble(ScenarioParts { id: "two".into(), agents, ..ScenarioParts::default() }).unwrap()
}

fn moment(animation: &Animation<'_>, step: usize) -> Vec<[u8; 4]> {
    let view = View::default();
    let scenes = vec![Scene::new(animation.scenario, &view)];
    let camera = Camera::new(animation, &scenes, f64::from(animation.size));
    let panels = &[Panel::default()];
    Stage { panels, scenes, camera, size: animation.size as usize }.draw(step).unwrap()
}

#[test]
fn a_fixed_camera_sees_the_whole_path() {
    let scenario = scenario(10.0);
    let animation = Animation { size: 400, ..Animation::new(&scenario, Vec::new()) };
    let orange = |picture: &[[u8; 4]]| {
        picture.iter().filter(|c| c[0] > 180 && c[2] < 40 && c[1] > 60 && c[1] < 120).count()
    };
    for step in [0, 40, 80] {
        assert!(orange(&moment(&animation, step)) > 20, "the AV is there at step {step}");
    }
    // A fixed camera has the AV in its centre half-way, a following one always.
    let middle = |follow: bool, step: usize| {
        let animation = Animation { follow, ..animation.clone() };
        moment(&animation, step)[(26 + 200) * 400 + 200]
    };
    let is_av = |c: [u8; 4]| c[0] > 180 && c[2] < 60;
    assert!(is_av(middle(true, 0)) && is_av(middle(true, 80)));
    assert!(!is_av(middle(false, 0)) && is_av(middle(false, 40)));
}

#[test]
fn an_animation_of_any_settings_is_made_or_refused() {
    let scenario = scenario(0.0);
    for every in [0, 3, 500] {
        let animation = Animation { size: 100, every, ..Animation::new(&scenario, Vec::new()) };
        let steps = animation.steps();
        assert_eq!((steps[0], steps[steps.len() - 1]), (0, 80));
    }
    let short = Animation { every: 30, until: 45, ..Animation::new(&scenario, Vec::new()) };
    assert_eq!(short.steps(), [0, 30, 45]);
    let length = Length { history: 2, future: 250 };
    let track = vec![Some(AgentState { x: 0.0, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 }); length.frames()];
    let agents = vec![LoggedAgent { track, ..agent("ego", 0.0, 0.0) }];
    let parts = ScenarioParts { id: "long".into(), length, agents, ..ScenarioParts::default() };
    let long = Scenario::assemble(parts).unwrap();
    let animation = Animation { size: 100, every: 100, ..Animation::new(&long, Vec::new()) };
    assert_eq!(animation.steps(), [0, 100, 200, 250]);
    assert_eq!(Animation { until: 120, ..animation.clone() }.steps(), [0, 100, 120]);
    assert_eq!(Animation { until: usize::MAX, ..animation.clone() }.steps(), [0, 100, 200, 250]);
    assert_eq!(animation.picture(usize::MAX).unwrap(), animation.picture(250).unwrap());
    assert_ne!(animation.picture(249).unwrap(), animation.picture(250).unwrap());
    assert_eq!(&animation.encode().unwrap()[..6], b"GIF89a");
    let odd = Animation {
        size: 1,
        every: 40,
        radius: Some(f64::NAN),
        ..Animation::new(
            &scenario,
            vec![
                Panel { title: "Ünknown † name, far too long to be shown".into(), ..Panel::default() };
                5
            ],
        )
    };
    let bytes = odd.encode().unwrap();
    assert_eq!(&bytes[..6], b"GIF89a");
    assert_eq!(usize::from(bytes[6]) + 256 * usize::from(bytes[7]), 4 * 108 - 8);
    let tall = Animation { size: 1200, ..Animation::new(&scenario, vec![Panel::default(); 300]) };
    assert!(tall.encode().unwrap_err().to_string().contains("take smaller or fewer panels"));
}

#[test]
fn a_picture_shows_one_step() {
    let scenario = scenario(10.0);
    let animation = Animation { size: 160, ..Animation::new(&scenario, Vec::new()) };
    let picture = animation.picture(40).unwrap();
    assert_eq!((picture.width, picture.height), (160, 26 + 160 + 20));
    assert_eq!(picture.rgb.len(), 3 * picture.width * picture.height);
    assert_ne!(picture, animation.picture(41).unwrap());
}

#[test]
fn panels_that_show_the_same_are_equal() {
    let scenario = scenario(10.0);
    let view = View::default();
    let animation = Animation { size: 160, ..Animation::new(&scenario, Vec::new()) };
    let panels = [const { Panel { title: String::new(), rollout: None, marks: Vec::new() } }; 4];
    let scenes: Vec<Scene<'_>> = panels.iter().map(|_| Scene::new(&scenario, &view)).collect();
    let camera = Camera::new(&animation, &scenes, 160.0);
    let stage = Stage { panels: &panels, scenes, camera, size: 160 };
    for row in stage.draw(40).unwrap().chunks_exact(stage.width()) {
        assert!(row.chunks(168).all(|panel| panel[..160] == row[..160]));
    }
}
