//! Digest of the whole content of a scenario, for provenance and to detect damage.

use reactsim_geometry::{Polygon, Vec2};

use super::{Certificate, DeviatedTrack, Frame, LaneArea, Scenario};

impl Scenario {
    /// Returns the BLAKE3 digest of the whole content, as 64 hexadecimal digits. Equal scenarios have equal
    /// digests on every machine.
    pub fn digest(&self) -> String {
        let mut sink = Sink::default();
        sink.text("reactsim-scenario-1");
        sink.text(&self.id);
        sink.text(&self.source);
        sink.point(self.origin);
        sink.list(&self.timestamps, |s, t| s.number(*t));
        sink.list(&self.tracks_to_predict, |s, id| s.text(id));
        sink.list(&self.objects_of_interest, |s, id| s.text(id));
        sink.count(self.start.agents.len());
        for (i, agent) in self.start.agents.iter().enumerate() {
            sink.agent(agent);
            sink.list(&self.start.history[i], Sink::frame);
            sink.list(&self.log_future.tracks[i], Sink::frame);
        }
        sink.list(&self.unselected, |s, a| {
            s.agent(&a.agent);
            s.list(&a.track, Sink::frame);
        });
        sink.count(self.start.lights.len());
        for (i, light) in self.start.lights.iter().enumerate() {
            sink.count(light.lane);
            sink.point(light.stop_point);
            for state in self.start.light_history[i].iter().chain(&self.log_future.lights[i]) {
                sink.byte(state.map_or(u8::MAX, |s| s.code()));
            }
        }
        sink.byte(u8::from(self.deviation.is_some()));
        if let Some(deviation) = &self.deviation {
            sink.deviation(deviation);
        }
        sink.list(&self.repairs.iter().collect::<Vec<_>>(), |s, (what, n)| {
            s.text(what);
            s.count(**n as usize);
        });
        self.hash_map(&mut sink);
        if self.start.has_levels() {
            self.hash_heights(&mut sink);
        }
        sink.digest()
    }

    /// Adds all heights. Nothing is written for scenarios of one level, which have none: their digests are
    /// those from before heights existed.
    fn hash_heights(&self, sink: &mut Sink) {
        sink.text("heights");
        let put = |s: &mut Sink, list: &Vec<Option<f64>>| {
            s.list(list, |s, height| s.number(height.unwrap_or(f64::NAN)));
        };
        sink.list(&self.start.heights, put);
        sink.list(&self.log_future.heights, put);
        sink.list(&self.unselected, |s, a| put(s, &a.heights));
        put(sink, &self.start.obstacle_heights);
        for list in self.start.map.heights.lists() {
            sink.list(list, |s, heights| s.list(heights, |s, height| s.number(*height)));
        }
    }

    fn hash_map(&self, sink: &mut Sink) {
        let map = &self.start.map;
        sink.list(&map.lanes, |s, lane| {
            s.text(&lane.id);
            s.byte(lane.kind as u8);
            s.byte(lane.class as u8);
            s.number(lane.speed_limit.unwrap_or(f64::NAN));
            s.points(lane.baseline.points());
            match &lane.area {
                LaneArea::Polygon(ring) => s.points(ring),
                LaneArea::Corridor { half_width } => s.number(*half_width),
            }
            s.list(&lane.successors, |s, i| s.count(*i));
            s.list(&lane.predecessors, |s, i| s.count(*i));
            for side in [&lane.left, &lane.right] {
                s.list(side, |s, n| {
                    s.count(n.lane);
                    for v in [n.self_start, n.self_end, n.other_start, n.other_end] {
                        s.count(v as usize);
                    }
                });
            }
        });
        sink.list(&map.road_edges, |s, e| {
            s.byte(e.kind as u8);
            s.points(&e.points);
        });
        sink.list(&map.road_lines, |s, l| {
            s.byte(l.paint);
            s.points(&l.points);
        });
        sink.list(&map.stop_lines, |s, l| {
            s.byte(l.kind as u8);
            s.count(l.lane);
            s.number(l.s);
            s.points(&l.ends);
        });
        sink.list(&map.crosswalks, |s, c| s.points(&c.outline));
        sink.list(&map.speed_bumps, |s, c| s.points(&c.outline));
        sink.list(&map.driveways, |s, c| s.points(&c.outline));
        sink.list(&map.intersections, |s, r| s.points(r));
        sink.byte(u8::from(map.drivable_area.is_some()));
        sink.list(map.drivable_area.as_deref().unwrap_or_default(), |s, p: &Polygon| {
            s.points(&p.exterior);
            s.list(&p.holes, |s, h| s.points(h));
        });
    }
}

impl DeviatedTrack {
    /// Returns the BLAKE3 digest of the whole content, as 64 hexadecimal digits.
    pub fn digest(&self) -> String {
        let mut sink = Sink::default();
        sink.deviation(self);
        sink.digest()
    }
}

/// Serialized bytes, with a length before every list, so that different contents never give the same bytes.
#[derive(Default)]
struct Sink {
    hasher: blake3::Hasher,
    /// Bytes that are not hashed yet.
    rest: Vec<u8>,
}

/// Number of bytes that are hashed at a time: the processor's cache holds them, and whole parts of this
/// length are hashed fastest.
const PART: usize = 1 << 16;

impl Sink {
    fn digest(mut self) -> String {
        self.hasher.update(&self.rest).finalize().to_hex().to_string()
    }

    fn byte(&mut self, v: u8) {
        self.rest.push(v);
    }

    fn deviation(&mut self, deviation: &DeviatedTrack) {
        self.text(deviation.category.map_or("", |c| c.name()));
        self.list(&deviation.track, |s, state| s.frame(&Some(*state)));
        // Nothing is written for a missing certificate, to keep the digests from before certificates
        // existed.
        if let Some(certificate) = &deviation.certificate {
            self.certificate(certificate);
        }
    }

    fn count(&mut self, v: usize) {
        let whole = self.rest.len() / PART * PART;
        if whole > 0 {
            self.hasher.update(&self.rest[..whole]);
            self.rest.drain(..whole);
        }
        self.rest.extend_from_slice(&(v as u64).to_le_bytes());
    }

    fn number(&mut self, v: f64) {
        self.rest.extend_from_slice(&bytes(v));
    }

    /// Adds groups of numbers.
    fn numbers<const N: usize>(&mut self, groups: impl ExactSizeIterator<Item = [f64; N]>) {
        let from = self.rest.len();
        self.rest.resize(from + 8 * N * groups.len(), 0);
        for (place, group) in self.rest[from..].chunks_exact_mut(8 * N).zip(groups) {
            place.chunks_exact_mut(8).zip(group).for_each(|(place, v)| place.copy_from_slice(&bytes(v)));
        }
    }

    fn text(&mut self, v: &str) {
        self.count(v.len());
        self.rest.extend_from_slice(v.as_bytes());
    }

    fn list<T>(&mut self, items: &[T], mut put: impl FnMut(&mut Self, &T)) {
        self.count(items.len());
        items.iter().for_each(|item| put(self, item));
    }

    fn point(&mut self, p: Vec2) {
        self.number(p.x);
        self.number(p.y);
    }

    fn points(&mut self, points: &[Vec2]) {
        self.count(points.len());
        self.numbers(points.iter().map(|p| [p.x, p.y]));
    }

    fn agent(&mut self, agent: &super::Agent) {
        self.text(&agent.id);
        self.byte(agent.kind as u8);
        self.number(agent.length);
        self.number(agent.width);
    }

    fn certificate(&mut self, certificate: &Certificate) {
        self.text("certificate");
        self.list(&certificate.responses, |s, r| {
            s.text(&r.agent);
            s.text(r.leader.as_deref().unwrap_or(""));
            s.count(r.reaction_step);
            let effort = r.effort.map_or([f64::NAN; 2], |e| [e.required_deceleration, e.time_to_react]);
            let values = [r.nudge, r.peak_deceleration, r.clearance, effort[0], effort[1]];
            s.numbers(std::iter::once(values));
            s.list(&r.track, |s, state| s.frame(&Some(*state)));
        });
    }

    fn frame(&mut self, frame: &Frame) {
        self.byte(u8::from(frame.is_some()));
        if let Some(s) = frame {
            self.numbers(std::iter::once([s.x, s.y, s.heading, s.vx, s.vy]));
        }
    }
}

/// Returns the bytes of a number. All NaNs are equal: they mean "unknown".
fn bytes(v: f64) -> [u8; 8] {
    (if v.is_nan() { f64::NAN } else { v }).to_le_bytes()
}
