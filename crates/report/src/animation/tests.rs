use reactsim_scene::{Agent, AgentKind, AgentState, FRAMES, LoggedAgent, ScenarioParts};

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

fn moment(animation: &Animation<'_>, step: usize) -> picture::Picture {
    let view = View { size: f64::from(animation.size), ..View::default() };
    let views = [view];
    let camera = Camera::new(animation, &views, f64::from(animation.size));
    let view = View { radius: camera.radius, ..views[0].clone() };
    let panels = [Panel::default()];
    let renderers = vec![StepRenderer::new(animation.scenario, &view)];
    Stage::new(&panels, renderers, camera, animation.size as usize).draw(step).unwrap()
}

#[test]
fn the_changed_rectangle_is_all_that_is_written() {
    let before = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1];
    let mut after = before;
    assert_eq!(
        change(Some(&before), &after, 4),
        difference::Change { left: 0, top: 0, width: 1, height: 1, pixels: vec![palette::TRANSPARENT] }
    );
    (after[6], after[9]) = (2, 3);
    let t = palette::TRANSPARENT;
    assert_eq!(
        change(Some(&before), &after, 4),
        difference::Change { left: 1, top: 1, width: 2, height: 2, pixels: vec![t, 2, 3, t] }
    );
    let all = change(None, &after, 4);
    assert_eq!((all.width, all.height, &all.pixels[..]), (4, 3, &after[..]));
}

#[test]
fn few_colours_are_kept_and_many_are_clustered() {
    let few = BTreeMap::from([([255, 255, 255], 9000), ([10, 20, 30], 1), ([213, 94, 0], 40)]);
    let mut palette = Palette::new(&few, 95);
    let shown = |palette: &mut Palette, colour: Colour| {
        let index = usize::from(palette.indices(&[colour])[0]);
        let table = palette.table();
        [table[3 * index], table[3 * index + 1], table[3 * index + 2]]
    };
    for colour in few.keys() {
        assert_eq!(shown(&mut palette, *colour), *colour);
    }
    assert_eq!(palette.indices(&[[254, 255, 255]; 2]), palette.indices(&[[255, 255, 255]; 2]));

    // A large flat area and a small bright one among a ramp of greys.
    let mut many: BTreeMap<Colour, u64> = (0..=255).map(|v| ([v, v, v], 3)).collect();
    many.extend([([244, 243, 239], 100_000), ([213, 94, 0], 30)]);
    let mut palette = Palette::new(&many, 16);
    assert!(palette.table().len() <= 3 * 17);
    for colour in [[244, 243, 239], [213, 94, 0]] {
        assert_eq!(shown(&mut palette, colour), colour);
    }
    for v in 0..=255_u8 {
        let [r, g, b] = shown(&mut palette, [v; 3]);
        let off = r.abs_diff(v).max(g.abs_diff(v)).max(b.abs_diff(v));
        assert!(off <= 32, "{v} became {r} {g} {b}");
    }
    let none = Palette::new(&BTreeMap::new(), 16).indices(&[[1, 2, 3]]);
    assert_eq!(none, [palette::TRANSPARENT]);
}

#[test]
fn colours_are_read() {
    assert_eq!(palette::rgb("#d55e00"), [0xd5, 0x5e, 0x00]);
    assert_eq!(palette::rgb("red"), [0, 0, 0]);
}

#[test]
fn a_fixed_camera_sees_the_whole_path() {
    let scenario = scenario(10.0);
    let animation = Animation { size: 400, ..Animation::new(&scenario, Vec::new()) };
    let orange = |picture: &picture::Picture| {
        picture.pixels.iter().filter(|c| c[0] > 180 && c[2] < 40 && c[1] > 60 && c[1] < 120).count()
    };
    for step in [0, 40, 80] {
        assert!(orange(&moment(&animation, step)) > 20, "the AV is there at step {step}");
    }
    // A fixed camera has the AV in its centre half-way, a following one always.
    let middle = |follow: bool, step: usize| {
        let animation = Animation { follow, ..animation.clone() };
        let picture = moment(&animation, step);
        picture.pixels[(26 + 200) * 400 + 200]
    };
    let is_av = |c: Colour| c[0] > 180 && c[2] < 60;
    assert!(is_av(middle(true, 0)) && is_av(middle(true, 80)));
    assert!(!is_av(middle(false, 0)) && is_av(middle(false, 40)));
}

#[test]
fn an_animation_of_any_settings_is_made_or_refused() {
    let scenario = scenario(0.0);
    for every in [0, 3, 500] {
        let animation = Animation { size: 100, every, ..Animation::new(&scenario, Vec::new()) };
        let steps = animation.steps();
        assert_eq!((steps[0], steps[steps.len() - 1]), (0, FUTURE));
    }
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
