//! The report page: what it says equals what the run found, it works by mouse, keyboard and address, and
//! nothing of a run becomes markup.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::chromium::{Browser, Served, chromium};
use crate::program::{MINI, json_of, lines_of, program, result, said, stderr, text};
use crate::small_scenarios::{deviating, write};

const MODELS: &str = "log-replay,constant-velocity,stop,idm";
/// Longest answer to anything that is done to the list, milliseconds.
const PROMPT: f64 = 100.0;

/// Keeps the last download of a page in `window.last`.
const KEEP_DOWNLOADS: &str = "const made = URL.createObjectURL; \
    URL.createObjectURL = (blob) => { window.last = blob; return made.call(URL, blob); }";

/// Returns the data in a page.
pub(crate) fn data_of(page: &str) -> Value {
    let data = page.split_once("id=\"data\">").unwrap().1.split_once("</script>").unwrap().0;
    serde_json::from_str(data).unwrap()
}

/// A run of the scenarios at a path with its page, and the page's address.
fn page(folder: &Path, scenarios: &str, options: &[&str]) -> (PathBuf, String) {
    let (run, page) = (folder.join("run"), folder.join("page.html"));
    said(&["run", scenarios, "--models", MODELS, "--out", text(&run), "--keep-rollouts"], 0);
    let begin = ["report", text(&run), "--format", "html", "--scenarios", scenarios, "--out", text(&page)];
    assert_eq!(said(&[&begin, options].concat(), 0).1, "");
    let address = format!("file://{}", page.display());
    (run, address)
}

fn open(page: &mut Browser, address: &str) {
    page.open("about:blank");
    page.requests.clear();
    page.open(address);
    page.until("document.body?.dataset.ready === 'yes'");
}

/// Returns a number of each element that a selector finds: the value of an expression of `e`.
fn numbers(page: &mut Browser, selector: &str, of: &str) -> Vec<f64> {
    let all = page.evaluate(&format!("[...document.querySelectorAll('{selector}')].map(e => Number({of}))"));
    all.as_array().unwrap().iter().filter_map(Value::as_f64).collect()
}

/// Returns the coordinates of the points of a chart.
fn points(page: &mut Browser, chart: &str) -> Vec<[f64; 2]> {
    let selector = format!("[data-chart=\"{chart}\"] path[data-x]");
    let [x, y] = ["e.dataset.x", "e.dataset.y"].map(|of| numbers(page, &selector, of));
    x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
}

/// Checks that a chart has the offsets of the deviated AVs of a run, by scenario.
fn check_endpoints(page: &mut Browser, chart: &str, run: &Path) {
    let mut expected: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for row in lines_of(&run.join("rows.jsonl")) {
        let of = |name: &str| row["deviation"][name].as_f64();
        if let Some((x, y)) = of("endpoint_longitudinal").zip(of("endpoint_lateral")) {
            expected.insert(row["scenario"].as_str().unwrap().to_owned(), [x, y]);
        }
    }
    let titles = page.evaluate(&format!(
        "[...document.querySelectorAll('[data-chart=\"{chart}\"] path[data-x] title')].map(e => e.textContent)"
    ));
    let shown = points(page, chart);
    assert!(shown.len() == expected.len() && shown.len() > 5, "{chart}");
    for (title, shown) in titles.as_array().unwrap().iter().zip(shown) {
        let expected = expected[title.as_str().unwrap()];
        for (shown, value) in shown.into_iter().zip(expected) {
            assert!((shown - value).abs() <= 1e-5 * value.abs(), "{chart}: {title}: {shown} {value}");
        }
    }
}

fn clean(page: &Browser) {
    assert_eq!(page.errors, Vec::<String>::new());
    let foreign = |url: &&String| !["file:", "data:", "blob:", "about:"].iter().any(|s| url.starts_with(s));
    assert_eq!(page.requests.iter().find(foreign), None);
    assert_eq!(page.requests.iter().filter(|url| url.starts_with("file:")).count(), 1);
}

#[test]
fn the_page_says_what_the_run_found() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let (run, address) = page(folder.path(), MINI, &["--all"]);
    let mut page = Browser::new(&chromium);
    open(&mut page, &address);

    // The table: every number of the summary, the best in bold but never an oracle.
    let summary = json_of(&run.join("summary.json"));
    let cells = page.evaluate(
        "[...document.querySelectorAll('#main-table tbody tr')].flatMap(r => [...r.querySelectorAll('td[data-mean]')].map(c => \
         [r.querySelector('th').textContent, c.dataset.metric, Number(c.dataset.mean), c.firstChild.textContent, !!c.querySelector('strong')]))",
    );
    let cells = cells.as_array().unwrap();
    let ids: BTreeMap<String, &Value> = summary["provenance"]["simulators"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| (s["title"].as_str().unwrap().to_owned(), s))
        .collect();
    assert!(cells.len() >= 4 * 8, "{}", cells.len());
    let mut best: BTreeMap<&str, f64> = BTreeMap::new();
    for cell in cells {
        let title = cell[0].as_str().unwrap();
        let metric = cell[1].as_str().unwrap();
        let simulator = ids[title.trim_end_matches(" †")];
        let mean = &summary["simulators"][simulator["id"].as_str().unwrap()]["metrics"][metric]["mean"];
        assert_eq!(cell[2].as_f64(), mean.as_f64(), "{title} {metric}");
        assert_eq!(title.ends_with(" †"), simulator["oracle"] == true);
        if simulator["oracle"] != true && metric != "progress" {
            let least = best.entry(metric).or_insert(f64::INFINITY);
            *least = least.min(cell[2].as_f64().unwrap());
        }
    }
    for cell in cells.iter().filter(|c| c[1] != "progress") {
        let fair = !cell[0].as_str().unwrap().ends_with(" †");
        let is_least = cell[2].as_f64().unwrap() <= best[cell[1].as_str().unwrap()];
        assert!(!is_least || !fair || cell[4] == true, "{cell}");
        assert!(fair || cell[4] == false, "{cell}");
    }
    let (table, _) = said(&["report", text(&run)], 0);
    for cell in cells {
        assert!(table.contains(&format!(" {} ", cell[3].as_str().unwrap())), "{cell}");
    }
    let fewer = table.lines().find(|line| line.starts_with("Means of fewer scenarios: ")).unwrap();
    let about = page.text("main-about");
    assert!(about.ends_with(fewer), "{about}");

    // Sorting turns the rows; the categories have tables of their own.
    page.evaluate("document.querySelector('#main-table [data-key=\"ade\"]').click()");
    let order = numbers(&mut page, "#main-table td[data-metric=\"ade\"]", "e.dataset.mean");
    assert!(order.is_sorted() && order.len() == 4, "{order:?}");
    page.evaluate("document.querySelector('#parts [data-part=\"longitudinal\"]').click()");
    let cell = "#main-table tr[data-subject=\"3\"] td[data-metric=\"aav-ttc\"]";
    let expected = &summary["simulators"]["idm"]["by_category"]["longitudinal"]["metrics"]["aav-ttc"]["mean"];
    assert_eq!(numbers(&mut page, cell, "e.dataset.mean"), [expected.as_f64().unwrap()]);
    page.evaluate("document.getElementById('all-metrics').click()");
    let overlaps = "document.querySelectorAll('#main-table td[data-metric=\"aav-overlap\"]').length";
    assert_eq!(page.evaluate(overlaps), json!(4));

    // The charts stand on the files of the run.
    check_endpoints(&mut page, "endpoints", &run);
    let counts = numbers(&mut page, "[data-chart=\"count-aav-collision\"] path[data-x]", "e.dataset.x");
    let means: Vec<f64> = ["log-replay", "constant-velocity", "stop", "idm"]
        .map(|id| summary["simulators"][id]["metrics"]["aav-collision"]["mean"].as_f64().unwrap())
        .to_vec();
    assert_eq!(counts, means);
    // Distributions have a line per simulator, of all scenarios with a value, from 0 to 1.
    let selector = "[data-chart=\"distribution-ade\"] path[data-values]";
    let lines = numbers(&mut page, selector, "e.dataset.values");
    let scenarios = summary["simulators"]["idm"]["metrics"]["ade"]["scenarios"].as_f64().unwrap();
    assert!(lines.len() == 4 && lines.contains(&scenarios), "{lines:?}");

    // Every download is what the program prints.
    page.evaluate(KEEP_DOWNLOADS);
    for (name, format) in [("results.csv", "csv"), ("results.json", "json"), ("results.tex", "latex")] {
        let script = format!(
            "(async () => {{ [...document.querySelectorAll('#downloads button')].find(b => b.textContent === '{name}').click(); return await window.last.text(); }})()"
        );
        let (expected, _) = said(&["report", text(&run), "--format", format], 0);
        assert_eq!(page.evaluate(&script), expected, "{name}");
    }
    // A figure is saved with its colours.
    let figure = page.evaluate("(async () => { document.querySelector('.card button').click(); return await window.last.text(); })()");
    let figure = figure.as_str().unwrap();
    assert!(figure.starts_with("<svg") && figure.contains("rgb(") && !figure.contains("var("), "{figure}");
    clean(&page);
}

#[test]
fn the_first_screen_shows_a_collision_and_a_reaction() {
    let folder = tempfile::tempdir().unwrap();
    let (run, address) = page(folder.path(), MINI, &["--cases", "0"]);
    let text = fs::read_to_string(folder.path().join("page.html")).unwrap();
    let data = data_of(&text);
    let lead = |name: &str| usize::try_from(data["lead"][name].as_u64().unwrap()).unwrap();
    assert!(text.contains(&format!("id=\"scene-{}\"", lead("scenario"))), "it has a scene without --cases");
    let scenario = &data["scenarios"]["id"][lead("scenario")];
    let hits = |side: &str| {
        let simulator = &data["subjects"][lead(side)]["id"];
        let events = lines_of(&run.join("events.jsonl"));
        let of_side = |e: &&Value| e["scenario"] == *scenario && e["simulator"] == *simulator;
        events
            .iter()
            .filter(of_side)
            .filter(|e| e["metric"] == "aav-collision" && e["counted"] == true)
            .count()
    };
    assert!(hits("left") > 0 && hits("right") == 0, "{}", data["lead"]);
    let right = data["subjects"][lead("right")]["id"].as_str().unwrap();
    assert!(!["constant-velocity", "stop", "log-replay"].contains(&right), "{right} cannot react");

    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let mut page = Browser::new(&chromium);
    open(&mut page, &address);
    page.until(&format!("document.body.dataset.lead === '{}'", lead("scenario")));
    assert_eq!(page.evaluate("document.querySelectorAll('#lead-panes canvas').length"), json!(2));
    let about = page.text("lead-about");
    assert!(
        about.contains("a vehicle hits the AV at ") && about.contains(scenario.as_str().unwrap()),
        "{about}"
    );
    page.evaluate("document.getElementById('lead-open').click()");
    page.until(&format!("location.hash.includes('scenario={}')", scenario.as_str().unwrap()));
    clean(&page);
}

#[test]
fn the_viewer_is_worked_by_mouse_keys_and_address() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let (run, address) = page(folder.path(), MINI, &["--all"]);
    let events = lines_of(&run.join("events.jsonl"));
    let hit = events
        .iter()
        .find(|e| e["metric"] == "aav-collision" && e["simulator"] == "log-replay" && e["counted"] == true)
        .unwrap();
    let (scenario, step) = (hit["scenario"].as_str().unwrap(), hit["step"].as_u64().unwrap());
    let mut page = Browser::new(&chromium);

    // An address names scenario, time and simulators.
    open(&mut page, &format!("{address}#scenario={scenario}&t=1.5&left=log-replay&right=idm"));
    page.until("!document.getElementById('stage').hidden");
    assert_eq!(page.text("scene-id"), scenario);
    page.until("document.getElementById('time').textContent === '1.5 s'");
    let chosen = "[0, 1].map(i => document.getElementById(`pane-${i}`).selectedOptions[0].textContent)";
    assert_eq!(page.evaluate(chosen), json!(["Log Replay †", "IDM"]));

    // To the event: by its entry in the list, then by keys.
    page.evaluate(&format!(
        "[...document.querySelectorAll('button.event')].find(b => b.textContent.includes('left: at fault') && b.dataset.from === '{}').click()",
        step + 10
    ));
    let time = format!("{:.1} s", step as f64 / 10.0);
    page.until(&format!("document.getElementById('time').textContent === '{time}'"));
    page.until("Number(document.querySelector('#now [data-pane=\"0\"][data-now=\"aav-collision\"]').textContent) > 0");
    assert_eq!(
        page.evaluate(
            "document.querySelector('#now [data-pane=\"1\"][data-now=\"aav-collision\"]').textContent"
        ),
        "0"
    );
    page.press("0");
    page.until("document.getElementById('time').textContent === '0.0 s'");
    page.evaluate("document.activeElement.blur()");
    page.press("]");
    page.until("document.getElementById('time').textContent !== '0.0 s'");
    page.press("[");
    page.press("0");
    page.until("document.getElementById('time').textContent === '0.0 s'");
    page.press(" ");
    page.until("parseFloat(document.getElementById('time').textContent) > 0.4");
    page.press(" ");
    page.evaluate("window.paused = document.getElementById('time').textContent");
    page.evaluate("new Promise(r => setTimeout(r, 200))");
    assert_eq!(page.evaluate("window.paused === document.getElementById('time').textContent"), true);
    let shared = page.evaluate("location.hash").as_str().unwrap().to_owned();
    assert!(shared.contains(&format!("scenario={scenario}")) && shared.contains("right=idm"), "{shared}");

    // Both views show the same place; the picture differs from one time to the other.
    let picture = "document.querySelector('.pane canvas').toDataURL()";
    page.press("0");
    page.until("document.getElementById('time').textContent === '0.0 s'");
    page.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))");
    let before = page.evaluate(picture);
    for _ in 0..4 {
        page.press("ArrowRight");
    }
    page.until("document.getElementById('time').textContent === '0.4 s'");
    page.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))");
    assert_ne!(page.evaluate(picture), before);
    // Layers can be taken away.
    let with_map = page.evaluate(picture);
    page.evaluate("document.getElementById('layer-map').click()");
    page.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))");
    assert_ne!(page.evaluate(picture), with_map);

    // The agent under the pointer is named: the AV is in the middle of a view that follows it.
    page.press("v");
    page.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))");
    let tip = page.evaluate(
        "(() => { const c = document.querySelector('.pane canvas'), b = c.getBoundingClientRect(); \
         c.dispatchEvent(new PointerEvent('pointermove', { clientX: b.x + b.width / 2, clientY: b.y + b.height / 2, bubbles: true })); \
         return document.getElementById('tip').textContent; })()",
    );
    let tip = tip.as_str().unwrap();
    assert!(tip.starts_with("AV (") && tip.contains("m/s²") && tip.contains("class vehicle"), "{tip}");
    page.press("v");

    // The list by keys alone: the second row, then the viewer shows it.
    page.evaluate("document.getElementById('list').focus()");
    for key in ["Home", "ArrowDown", "Enter"] {
        page.press(key);
    }
    let second = page.evaluate("document.querySelectorAll('#list-body .row')[1].dataset.scenario");
    page.until(&format!("document.body.dataset.scenario === '{}'", second.as_str().unwrap()));

    // A filter and an order.
    page.evaluate("const f = document.getElementById('list-condition'); f.value = 'differ'; f.dispatchEvent(new Event('change'))");
    let differ: usize =
        page.evaluate("parseInt(document.getElementById('list-count').textContent)").as_u64().unwrap()
            as usize;
    let mut hits: BTreeMap<&str, std::collections::BTreeSet<&str>> = BTreeMap::new();
    for e in events.iter().filter(|e| e["metric"] == "aav-collision" && e["counted"] == true) {
        hits.entry(e["scenario"].as_str().unwrap()).or_default().insert(e["simulator"].as_str().unwrap());
    }
    let fair = ["constant-velocity", "stop", "idm"];
    let expected = hits.values().filter(|h| {
        let n = fair.iter().filter(|s| h.contains(*s)).count();
        n > 0 && n < fair.len()
    });
    assert_eq!(differ, expected.count());

    // A case study is one drawing with a panel for every simulator and time.
    open(&mut page, &format!("{address}#scenario={scenario}&t=0&left=log-replay&right=idm"));
    page.evaluate(KEEP_DOWNLOADS);
    page.until("!document.getElementById('stage').hidden");
    let strip = page.evaluate(
        "(async () => { const t = document.getElementById('strip-times'); t.value = '0, 2.5, 5'; document.getElementById('strip-save').click(); const text = await window.last.text(); \
         const xml = new DOMParser().parseFromString(text, 'image/svg+xml'); return [xml.querySelector('parsererror') === null, xml.querySelectorAll('svg svg').length, text.length, /NaN|undefined|var\\(/.test(text)]; })()",
    );
    assert_eq!((&strip[0], &strip[1], &strip[3]), (&json!(true), &json!(6), &json!(false)), "{strip}");

    // The view is saved as a picture and as a video.
    page.evaluate("window.last = null; document.getElementById('picture-save').click()");
    page.until("window.last?.type === 'image/png' && window.last.size > 10000");
    page.evaluate(
        "window.last = null; const s = document.getElementById('speed'); s.value = '4'; s.onchange(); document.getElementById('video-save').click()",
    );
    page.until("window.last?.type.startsWith('video/') && window.last.size > 10000");

    // Events state their units, and the view moves to them.
    let events = page.evaluate("[...document.querySelectorAll('#events li')].map(e => e.textContent)");
    let speeds: Vec<&str> = events
        .as_array()
        .unwrap()
        .iter()
        .filter_map(Value::as_str)
        .filter(|e| e.contains("speed "))
        .collect();
    assert!(!speeds.is_empty() && speeds.iter().all(|text| text.contains(" m/s")), "{events}");
    clean(&page);
}

#[test]
fn names_of_scenarios_and_simulators_are_text() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let hostile = "</script><img src=x onerror=\"window.hacked = 1\">&amp;<!--";
    let mut scenario = json_of(&Path::new(MINI).join("crossing.json"));
    scenario["id"] = hostile.into();
    for (i, agent) in scenario["agents"].as_array_mut().unwrap().iter_mut().enumerate() {
        agent["id"] = format!("{i}<b onmouseover=alert(1)>{hostile}").into();
    }
    scenario["av"] = Value::Null;
    scenario.as_object_mut().unwrap().remove("av");
    let file = folder.path().join("hostile.json");
    fs::write(&file, scenario.to_string()).unwrap();
    let (run, address) = page(folder.path(), text(&file), &["--all"]);
    let mut summary = json_of(&run.join("summary.json"));
    summary["provenance"]["simulators"][1]["title"] = format!("CV {hostile}").into();
    fs::write(run.join("summary.json"), summary.to_string()).unwrap();
    let path = folder.path().join("page.html");
    said(&["report", text(&run), "--format", "html", "--scenarios", text(&file), "--out", text(&path)], 0);

    let mut page = Browser::new(&chromium);
    open(&mut page, &address);
    page.until("!document.getElementById('stage').hidden");
    assert_eq!(page.text("scene-id"), hostile);
    assert_eq!(page.evaluate("document.querySelector('#list-body .row .id').textContent"), hostile);
    assert_eq!(
        page.evaluate("document.querySelector('#main-table tr[data-subject=\"1\"] th').textContent"),
        format!("CV {hostile}")
    );
    page.evaluate("document.getElementById('layer-ids').click()");
    page.evaluate(KEEP_DOWNLOADS);
    let strip = page.evaluate(
        "(async () => { document.getElementById('strip-save').click(); const xml = new DOMParser().parseFromString(await window.last.text(), 'image/svg+xml'); \
         return [xml.querySelector('parsererror') === null, xml.querySelectorAll('img, script').length]; })()",
    );
    assert_eq!(strip, json!([true, 0]));
    assert_eq!(
        page.evaluate("[typeof window.hacked, document.querySelectorAll('img').length]"),
        json!(["undefined", 0])
    );
    clean(&page);
}

/// A run folder as large as the paper's benchmark, made of a small one.
fn multiplied(run: &Path, to: &Path, scenarios: usize) {
    fs::create_dir(to).unwrap();
    for name in ["summary.json", "provenance.json"] {
        fs::copy(run.join(name), to.join(name)).unwrap();
    }
    for name in ["rows.jsonl", "events.jsonl"] {
        let mut by_record: BTreeMap<u64, Vec<Value>> = BTreeMap::new();
        for line in lines_of(&run.join(name)) {
            by_record.entry(line["input"].as_u64().unwrap()).or_default().push(line);
        }
        let kinds: Vec<Vec<Value>> = by_record.into_values().collect();
        let mut out = String::new();
        for i in 0..scenarios {
            for mut line in kinds[i % kinds.len()].clone() {
                line["record"] = (i / kinds.len()).into();
                let id = format!("{}-{i:04}", line["scenario"].as_str().unwrap());
                line["scenario"] = id.into();
                out.push_str(&format!("{line}\n"));
            }
        }
        fs::write(to.join(name), out).unwrap();
    }
}

#[test]
fn thousands_of_scenarios_are_listed_without_delay() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let (run, large, path) =
        (folder.path().join("run"), folder.path().join("large"), folder.path().join("page.html"));
    let models = "log-replay,constant-velocity,stop,idm,constant-velocity+qp,idm+qp";
    said(&["run", MINI, "--models", models, "--out", text(&run)], 0);
    multiplied(&run, &large, 2636);
    let (_, notes) = said(&["report", text(&large), "--format", "html", "--out", text(&path)], 0);
    assert!(
        notes.contains("no rollouts were kept of `large`: run with `keep-rollouts`")
            && notes.contains("give the files of the run as `scenarios`"),
        "{notes}"
    );
    assert!(fs::metadata(&path).unwrap().len() < 6_000_000, "{:?}", fs::metadata(&path));

    let mut page = Browser::new(&chromium);
    open(&mut page, &format!("file://{}", path.display()));
    assert_eq!(page.text("list-count"), "2,636 scenarios of 2,636");
    assert!(page.text("stage-note").contains("There are no scenes here"));
    // Each is done three times; what else runs on the machine may delay one of them.
    let measured = page.evaluate(
        "(async () => {
           const list = document.getElementById('list'), set = (id, value, kind) => { const f = document.getElementById(id); f.value = value; f.dispatchEvent(new Event(kind)); };
           const shown = () => new Promise(r => requestAnimationFrame(() => r()));
           const deeds = {
             scroll: (i) => { list.scrollTop = 9000 * (i + 1); list.dispatchEvent(new Event('scroll')); },
             sort: () => document.querySelector('#list-head [data-key=\"1\"]').click(),
             text: (i) => set('list-text', ['7', '77', ''][i], 'input'),
             condition: (i) => set('list-condition', ['differ', 'collision', ''][i], 'change'),
             metric: (i) => set('list-metric', ['ade', 'offroad', 'aav-ttc'][i], 'change'),
             key: () => list.dispatchEvent(new KeyboardEvent('keydown', { key: 'PageDown', bubbles: true })),
           };
           const out = {};
           for (const [name, deed] of Object.entries(deeds)) {
             out[name] = Infinity;
             for (let i = 0; i < 3; i++) {
               const begin = performance.now();
               deed(i);
               void list.offsetHeight;
               out[name] = Math.min(out[name], performance.now() - begin);
               await shown();
             }
           }
           return [out, document.querySelectorAll('#list-body .row').length, Number(list.getAttribute('aria-rowcount'))];
         })()",
    );
    for (name, took) in measured[0].as_object().unwrap() {
        assert!(took.as_f64().unwrap() < PROMPT, "{name}: {took} ms");
    }
    assert!(measured[1].as_u64().unwrap() < 40, "{measured}");
    assert_eq!(measured[2], 2637);
    clean(&page);
}

#[test]
fn runs_with_other_avs_are_not_mixed() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let (a, b, page) = (folder.path().join("a"), folder.path().join("b"), folder.path().join("page.html"));
    said(&["run", MINI, "--models", MODELS, "--out", text(&a)], 0);
    said(&["run", MINI, "--models", MODELS, "--av", "brake:4", "--out", text(&b)], 0);
    said(&["report", text(&a), text(&b), "--format", "html", "--scenarios", MINI, "--out", text(&page)], 0);
    let mut shown = Browser::new(&chromium);
    open(&mut shown, &format!("file://{}", page.display()));
    // A figure for each set of AVs, with the offsets of its own run.
    for (chart, run) in [("endpoints", &a), ("endpoints-2", &b)] {
        check_endpoints(&mut shown, chart, run);
    }
    // Every run has a best simulator of its own.
    let bold = shown.evaluate(
        "[...document.querySelectorAll('#main-table tbody tr')].filter(r => r.querySelector('td[data-metric=\"aav-collision\"] strong')).map(r => r.cells[0].textContent)",
    );
    let runs: std::collections::BTreeSet<&str> =
        bold.as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(runs, ["a", "b"].into(), "{bold}");

    // Filters and order are part of the address.
    shown.evaluate("document.querySelector('#main-table [data-key=\"aav-ttc\"]').click(); document.querySelector('#parts [data-part=\"lateral\"]').click(); const f = document.getElementById('list-condition'); f.value = 'risky'; f.dispatchEvent(new Event('change'))");
    let address = shown.evaluate("location.href");
    let address = address.as_str().unwrap().to_owned();
    for part in ["sort=aav-ttc", "part=lateral", "show=risky"] {
        assert!(address.contains(part), "{address}");
    }
    let table = shown.evaluate("document.getElementById('main-table').textContent");
    open(&mut shown, &address);
    assert_eq!(shown.evaluate("document.getElementById('main-table').textContent"), table);
    assert_eq!(shown.evaluate("document.getElementById('list-condition').value"), json!("risky"));
    clean(&shown);
}

#[test]
fn studies_have_their_tables_and_figures() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let study = |kind: &str, options: &[&str]| {
        let out = at(kind);
        let numbers = result(&[&["study", kind, MINI, "--out", text(&out)], options].concat());
        (out, numbers)
    };
    let (replan, of_replan) = study("replan", &["--models", "constant-velocity,idm", "--intervals", "5,20"]);
    let (realism, of_realism) =
        study("realism", &["--models", "log-replay,idm,stop", "--rollouts", "2", "--keep-rollouts"]);
    let (guards, of_guards) = study("guards", &["--models", "constant-velocity,idm"]);
    let (planners, of_planners) = study("planners", &["--models", "log-replay,idm", "--planners", "idm"]);
    let (errors, of_errors) = study("errors", &["--models", "constant-velocity,idm"]);
    let axes = at("axes");
    let arguments = ["study", MINI, "--models", "constant-velocity,idm", "--axis", "av=log,brake:4"];
    let of_axes = result(&[&arguments[..], &["--out", text(&axes)]].concat());
    let path = at("page.html");
    let folders = [&replan, &realism, &guards, &planners, &errors, &axes].map(|path| text(path));
    said(&[&["report"], &folders[..], &["--format", "html", "--out", text(&path)]].concat(), 0);
    let mut page = Browser::new(&chromium);
    open(&mut page, &format!("file://{}", path.display()));

    // Every number of a study stands in its section, none twice, none from elsewhere.
    for (kind, of_study) in [
        ("replan", &of_replan),
        ("realism", &of_realism),
        ("guards", &of_guards),
        ("planners", &of_planners),
        ("errors", &of_errors),
        ("axes", &of_axes),
    ] {
        let mut cells = format!("[data-study=\"{kind}\"] td[data-mean]");
        if kind == "planners" {
            cells.push_str(", #pairs td[data-mean]");
        }
        let mut shown = numbers(&mut page, &cells, "e.dataset.mean");
        let mut expected = Vec::new();
        for simulator in
            of_study["members"].as_array().unwrap().iter().flat_map(|m| m["simulators"].as_array().unwrap())
        {
            let parts = [&simulator["metrics"], &simulator["difference"]];
            let estimates = parts.into_iter().filter_map(Value::as_object).flat_map(|o| o.values());
            expected.extend(estimates.filter_map(|e| e["mean"].as_f64()));
        }
        for simulator in of_study["realism"].as_array().into_iter().flatten() {
            let aggregates = simulator["aggregates"].as_object().unwrap().values();
            expected.extend(aggregates.filter_map(|e| e["mean"].as_f64()));
        }
        for pair in of_study["planner_pairs"].as_array().into_iter().flatten() {
            let differences = pair["differences"].as_array().unwrap().iter();
            expected.extend(differences.chain([&pair["dependence"]]).filter_map(|d| d["mean"].as_f64()));
        }
        for simulator in of_study["errors"]["simulators"].as_array().into_iter().flatten() {
            let groups = simulator["groups"].as_array().unwrap();
            expected.extend(groups.iter().filter_map(|group| group["displacement"].as_f64()));
        }
        shown.sort_by(f64::total_cmp);
        expected.sort_by(f64::total_cmp);
        assert!(expected.len() >= 8, "{kind}: {of_study}");
        assert_eq!(shown, expected, "{kind}");
    }
    let body = page.evaluate("document.getElementById('studies').textContent");
    assert!(!body.as_str().unwrap().contains("undefined"), "{body}");
    // The case in which the difference of two planners changes most is a link to both, side by side.
    let case = of_planners["planners"]["change"]["scenario"].as_str().unwrap();
    let links = page.evaluate(
        "[...document.querySelectorAll('[data-study=\"planners\"] p a')].map(a => a.getAttribute('href')).join(' ')",
    );
    for part in [format!("scenario={case}&"), "left=idm%40".to_owned(), "right=log-replay%40".to_owned()] {
        assert!(links.as_str().unwrap().contains(&part), "{part}: {links}");
    }
    // The figures: a line per simulator over the intervals, and realism against reaction.
    let mut expected = Vec::new();
    for id in ["constant-velocity", "idm"] {
        for (steps, member) in [5.0, 20.0].into_iter().zip(of_replan["members"].as_array().unwrap()) {
            let simulator = member["simulators"].as_array().unwrap().iter().find(|s| s["id"] == id).unwrap();
            expected.push([steps, simulator["metrics"]["aav-collision"]["mean"].as_f64().unwrap()]);
        }
    }
    assert_eq!(points(&mut page, "replan-aav-collision"), expected);
    assert_eq!(points(&mut page, "realism-reactive").len(), 3);
    let reactive = of_realism["members"][0]["simulators"].as_array().unwrap();
    let expected: Vec<[f64; 2]> = of_realism["realism"]
        .as_array()
        .unwrap()
        .iter()
        .map(|scores| {
            let simulator = reactive.iter().find(|s| s["id"] == scores["id"]).unwrap();
            let realism = &scores["aggregates"]["realism_meta_metric"]["mean"];
            [realism, &simulator["metrics"]["aav-collision"]["mean"]].map(|mean| mean.as_f64().unwrap())
        })
        .collect();
    assert_eq!(expected.len(), 3);
    assert_eq!(points(&mut page, "challenge-reactive"), expected);
    clean(&page);

    // Tables of all its runs are those of run folders.
    let (table, _) = said(&["report", text(&replan), "--format", "csv"], 0);
    assert!(table.contains("\nreplan/steps-05,") && table.contains("\nreplan/steps-20,"), "{table}");
}

#[test]
fn the_page_of_planners_is_about_planners() {
    let folder = tempfile::tempdir().unwrap();
    let (out, path) = (folder.path().join("study"), folder.path().join("page.html"));
    let study = ["study", "planners", "--limit", "10", "--models", "log-replay,idm", "--planners", "idm"];
    said(&[&study[..], &["--out", text(&out)]].concat(), 0);
    said(&["report", text(&out), "--format", "html", "--out", text(&path)], 0);
    let page = fs::read_to_string(&path).unwrap();
    let data = data_of(&page);
    // First, the traffic decides whether a planner is at fault.
    let lead = &data["lead"];
    let number = |value: &Value| usize::try_from(value.as_u64().unwrap()).unwrap();
    let metric = data["metrics"].as_array().unwrap().iter().position(|m| m["id"] == "av-at-fault-collisions");
    let fault = |side: &str| {
        let values = &data["scenarios"]["values"][number(&lead[side])][metric.unwrap()];
        values[number(&lead["scenario"])].as_f64().unwrap() < 1.0
    };
    let run = |side: &str| number(&data["subjects"][number(&lead[side])]["run"]);
    assert!(lead["judged"] == true && fault("left") && !fault("right"), "{lead}");
    assert_eq!(run("left"), run("right"));
    assert_eq!(data["runs"][run("left")]["summary"]["provenance"]["settings"]["av"], "planner:idm");

    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let mut page = Browser::new(&chromium);
    open(&mut page, &format!("file://{}", path.display()));
    assert_eq!(page.text("h-results"), "How do planners drive among simulated road users?");
    page.until(&format!("document.body.dataset.lead === '{}'", number(&lead["scenario"])));
    assert!(
        page.text("lead-about").contains("The traffic changes the verdict on idm: its AV score is 0.000")
    );
    // Planners in the same traffic stand next to each other; every column has numbers.
    let names = "[...document.querySelectorAll('#av-table tbody tr')].map(r => [...r.children].slice(1, 3).map(c => \
                 c.textContent).join(' among '))";
    let expected = ["log among Log Replay †", "idm among Log Replay †", "log among IDM", "idm among IDM"];
    assert_eq!(page.evaluate(names), json!(expected));
    let empty = "[...document.querySelectorAll('#av-table thead button')].slice(3).filter(b => \
                 !document.querySelector(`#av-table td[data-metric=\"${b.dataset.key}\"][data-mean]`)).length";
    assert_eq!(page.evaluate(empty), json!(0));
    assert_eq!(page.evaluate("document.getElementById('list-metric').value"), "av-score");
    let overflow = "[...document.querySelectorAll('#list-head > *')].filter(c => \
                    c.scrollWidth > c.clientWidth + 1).length";
    assert_eq!(page.evaluate(overflow), json!(0));
    page.evaluate("{ const s = document.getElementById('list-condition'); s.value = 'verdict'; s.dispatchEvent(new Event('change')); }");
    let listed =
        page.evaluate("[...document.querySelectorAll('#list-body .row .id')].map(e => e.textContent)");
    let case = &data["scenarios"]["id"][number(&lead["scenario"])];
    assert!(listed.as_array().unwrap().contains(case), "{listed}");
    // The viewer has the values and events of the AV.
    page.evaluate("document.getElementById('lead-open').click()");
    page.until("document.getElementById('events').textContent.includes('AV no collision violated')");
    let whole =
        "document.querySelector('#now [data-pane=\"0\"][data-whole=\"av-at-fault-collisions\"]').textContent";
    assert_eq!(page.evaluate(whole), "0.000");
    clean(&page);
}

/// The answer of a server to a request for a path.
fn ask(served: &Served, path: &str) -> String {
    let host = served.url.trim_start_matches("http://").split('/').next().unwrap();
    let mut stream = TcpStream::connect(host).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn a_run_is_shown_with_every_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (run, _) = page(folder.path(), MINI, &[]);
    let showing = Served::new(&["view", text(&run), "--scenarios", MINI]);
    let base = &showing.url[showing.url.trim_start_matches("http://").find('/').unwrap() + 7..];
    assert!(ask(&showing, "/").starts_with("HTTP/1.1 404"));
    assert!(ask(&showing, "/0123/").contains("`reactsim view` printed"));
    let answer = ask(&showing, &format!("{base}scene/0"));
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer:.200}");
    assert!(answer.len() < 300_000, "{} bytes", answer.len());
    assert!(ask(&showing, &format!("{base}scene/99")).starts_with("HTTP/1.1 404"));
    assert!(ask(&showing, base).contains("content-security-policy: default-src 'none'; script-src 'sha256-"));

    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let mut page = Browser::new(&chromium);
    open(&mut page, &showing.url);
    page.until("!document.getElementById('stage').hidden");
    // All of them can be drawn, one after the other.
    assert_eq!(
        page.evaluate("[...document.querySelectorAll('#list-body .mark')].filter(m => m.textContent).length"),
        12
    );
    let first = page.evaluate("document.body.dataset.scenario");
    page.press("n");
    page.until(&format!("document.body.dataset.scenario !== '{}'", first.as_str().unwrap()));
    assert!(
        page.requests.iter().all(|url| url.starts_with(&showing.url) || url.starts_with("data:")),
        "{:?}",
        page.requests
    );
    assert_eq!(page.errors, Vec::<String>::new());
}

#[test]
fn what_can_not_be_shown_is_refused_or_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = at("run");
    said(&["run", MINI, "--models", "stop", "--limit", "3", "--out", text(&run), "--keep-rollouts"], 0);
    let html = |arguments: &[&str], code| {
        let out = at("page.html");
        said(&[&["report", "--format", "html", "--out", text(&out)], arguments].concat(), code).1
    };
    assert!(html(&[text(&at("none"))], 2).contains("is not a run folder"));
    assert!(html(&[text(&run), text(&run)], 2).contains("two runs are named"));
    assert!(html(&[text(&run), "--case", "nobody"], 2).contains("no run has a scenario `nobody`"));
    assert_eq!(html(&[text(&run)], 0), "", "the specification names the scenarios");
    fs::remove_file(run.join("spec.toml")).unwrap();
    assert!(html(&[text(&run)], 0).contains("give the files of the run as `scenarios`"));
    assert_eq!(html(&[text(&run), "--scenarios", MINI], 0), "");
    let page = fs::read(at("page.html")).unwrap();
    html(&[text(&run), "--scenarios", MINI], 0);
    assert!(page == fs::read(at("page.html")).unwrap(), "the same run gives the same page");
    // Events that are none, rollouts of another run, scenarios that changed.
    let events = run.join("events.jsonl");
    fs::write(&events, "{\"input\":0}\n").unwrap();
    assert!(html(&[text(&run), "--scenarios", MINI], 2).contains("events.jsonl cannot be read"));
    fs::write(&events, "").unwrap();
    let rows = fs::read_to_string(run.join("rows.jsonl")).unwrap();
    let digest = lines_of(&run.join("rows.jsonl"))[0]["digest"].as_str().unwrap().to_owned();
    fs::write(run.join("rows.jsonl"), rows.replace(&digest, &"0".repeat(64))).unwrap();
    assert!(html(&[text(&run), "--scenarios", MINI], 2).contains("is not the scenario with the digest 000"));
    fs::write(run.join("rows.jsonl"), rows).unwrap();
    let bytes = fs::read(run.join("rollouts.parquet")).unwrap();
    fs::write(run.join("rollouts.parquet"), &bytes[..bytes.len() / 2]).unwrap();
    assert!(html(&[text(&run), "--scenarios", MINI], 2).contains("rollouts.parquet"));
    said(&["view", text(&run), "--port", "1"], 2);
}

#[test]
fn every_value_of_an_event_has_a_unit() {
    let known: Vec<&str> = reactsim::metrics::EVENT_UNITS.iter().map(|(name, _)| *name).collect();
    let mut seen = std::collections::BTreeSet::new();
    for line in lines_of(&crate::reference::run().join("events.jsonl")) {
        seen.extend(line["values"].as_object().unwrap().keys().cloned());
    }
    assert!(seen.len() >= 8, "{seen:?}");
    assert!(seen.iter().all(|name| known.contains(&name.as_str())), "{seen:?}");
}

#[test]
fn inputs_are_found_where_the_run_read_them_and_in_the_current_folder() {
    let folder = tempfile::tempdir().unwrap();
    let other = tempfile::tempdir().unwrap();
    let scenarios = folder.path().join("mine.parquet");
    write(&scenarios, [deviating(0, true), deviating(1, true)]);
    let run = folder.path().join("run");
    said(&["run", text(&scenarios), "--models", "stop", "--keep-rollouts", "--out", text(&run)], 0);
    let messages = |place: &Path| {
        let report = ["report", text(&run), "--format", "html", "--out", "page.html"];
        let output = program().args(report).current_dir(place).output().unwrap();
        assert!(output.status.success());
        stderr(&output)
    };
    assert!(!messages(other.path()).contains("are missing"));
    fs::remove_file(run.join("spec.toml")).unwrap();
    assert!(!messages(folder.path()).contains("are missing"));
    assert!(messages(other.path()).contains("the scenarios of mine.parquet are missing"));
    // A file of the same name with other content is not the input.
    write(&other.path().join("mine.parquet"), [deviating(2, true)]);
    assert!(messages(other.path()).contains("the scenarios of mine.parquet are missing"));
    fs::write(other.path().join("mine.parquet"), "no scenarios").unwrap();
    assert!(messages(other.path()).contains("the scenarios of mine.parquet are missing"));
}
