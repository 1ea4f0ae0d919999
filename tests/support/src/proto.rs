//! Waymo messages made by hand, byte for byte, so that the reader is not tested against its own declarations.

/// Fields of a message that tests change.
#[derive(Clone)]
pub struct Proto {
    /// Id of the scenario.
    pub id: String,
    /// Number of frames.
    pub frames: usize,
    /// Index of the current frame.
    pub current: u64,
    /// Time between frames, seconds.
    pub step: f64,
    /// Index of the AV among the tracks.
    pub sdc: u64,
    /// Id, type, x at frame 0, heading, length, frames that are valid.
    pub tracks: Vec<(u64, u64, f64, f32, f32, std::ops::Range<usize>)>,
    /// Id and exits of lanes with three points.
    pub lanes: Vec<(u64, Vec<u64>)>,
    /// Lanes of lights.
    pub lights: Vec<u64>,
    /// Whether there are road edges, 6 m to both sides of the lanes, with the road on their left.
    pub edges: bool,
}

impl Default for Proto {
    fn default() -> Self {
        Self {
            id: "made".into(),
            frames: 91,
            current: 10,
            step: 0.1,
            sdc: 1,
            tracks: vec![
                (7, 1, 5020.0, 17.3, 4.0, 0..91),
                (8, 1, 5000.0, 0.0, 5.0, 0..91),
                (9, 2, 5003.0, 1.0, 0.6, 5..40),
            ],
            lanes: vec![(100, vec![101]), (101, vec![])],
            lights: vec![100],
            edges: false,
        }
    }
}

/// Appends a number in the coding of messages.
pub fn varint(out: &mut Vec<u8>, mut v: u64) {
    while v >= 128 {
        out.push((v as u8 & 127) | 128);
        v >>= 7;
    }
    out.push(v as u8);
}

fn whole(out: &mut Vec<u8>, tag: u64, v: u64) {
    varint(out, tag << 3);
    varint(out, v);
}

fn double(out: &mut Vec<u8>, tag: u64, v: f64) {
    varint(out, tag << 3 | 1);
    out.extend(v.to_le_bytes());
}

fn float(out: &mut Vec<u8>, tag: u64, v: f32) {
    varint(out, tag << 3 | 5);
    out.extend(v.to_le_bytes());
}

/// Appends a field of bytes.
pub fn bytes(out: &mut Vec<u8>, tag: u64, v: &[u8]) {
    varint(out, tag << 3 | 2);
    varint(out, v.len() as u64);
    out.extend(v);
}

fn message(out: &mut Vec<u8>, tag: u64, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut inner = Vec::new();
    fill(&mut inner);
    bytes(out, tag, &inner);
}

fn point(out: &mut Vec<u8>, tag: u64, x: f64, y: f64) {
    message(out, tag, |m| {
        double(m, 1, x);
        double(m, 2, y);
        double(m, 3, 12.0);
    });
}

impl Proto {
    /// Encodes the message.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        bytes(&mut out, 5, self.id.as_bytes());
        let mut times = Vec::new();
        (0..self.frames).for_each(|f| times.extend((f as f64 * self.step).to_le_bytes()));
        bytes(&mut out, 1, &times);
        whole(&mut out, 10, self.current);
        whole(&mut out, 6, self.sdc);
        whole(&mut out, 4, 7);
        message(&mut out, 11, |m| whole(m, 1, 0));
        // An unknown field.
        bytes(&mut out, 99, b"from a newer version");
        for (id, kind, x, heading, length, valid) in &self.tracks {
            message(&mut out, 2, |m| {
                whole(m, 1, *id);
                whole(m, 2, *kind);
                for f in 0..self.frames {
                    message(m, 3, |m| {
                        double(m, 2, x + f as f64);
                        double(m, 3, -20_000.0);
                        double(m, 4, 12.0);
                        float(m, 5, if *length == 0.0 { 0.0 } else { *length + f as f32 * 0.001 });
                        float(m, 6, 2.0);
                        float(m, 8, *heading);
                        float(m, 9, 10.0);
                        float(m, 10, 0.0);
                        whole(m, 11, u64::from(valid.contains(&f)));
                    });
                }
            });
        }
        for f in 0..self.frames {
            message(&mut out, 7, |m| {
                for lane in self.lights.iter().filter(|_| f % 2 == 0) {
                    message(m, 1, |m| {
                        whole(m, 1, *lane);
                        whole(m, 2, 4);
                        point(m, 3, 5040.0, -20_000.0);
                    });
                }
            });
        }
        for (i, (id, exits)) in self.lanes.iter().enumerate() {
            message(&mut out, 8, |m| {
                whole(m, 1, *id);
                message(m, 3, |m| {
                    double(m, 1, 25.0);
                    whole(m, 2, 2);
                    for k in 0..3 {
                        point(m, 8, 5000.0 + 40.0 * (i as f64) + 20.0 * f64::from(k), -20_000.0);
                    }
                    let mut packed = Vec::new();
                    exits.iter().for_each(|e| varint(&mut packed, *e));
                    bytes(m, 10, &packed);
                });
            });
        }
        for (id, from, to, y) in [(600, 4900.0, 5300.0, -20_006.0), (601, 5300.0, 4900.0, -19_994.0)] {
            if self.edges {
                message(&mut out, 8, |m| {
                    whole(m, 1, id);
                    message(m, 5, |m| {
                        whole(m, 1, 1);
                        point(m, 2, from, y);
                        point(m, 2, to, y);
                    });
                });
            }
        }
        message(&mut out, 8, |m| {
            whole(m, 1, 500);
            message(m, 7, |m| {
                whole(m, 1, 101);
                point(m, 2, 5050.0, -20_003.0);
            });
        });
        out
    }
}

/// Returns the checksum of a part of a TFRecord.
pub fn crc(data: &[u8]) -> [u8; 4] {
    crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

/// Returns payloads as TFRecords.
pub fn framed(payloads: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    for payload in payloads {
        let length = (payload.len() as u64).to_le_bytes();
        out.extend(length);
        out.extend(crc(&length));
        out.extend(payload);
        out.extend(crc(payload));
    }
    out
}

/// Returns messages as TFRecords.
pub fn records(protos: &[Proto]) -> Vec<u8> {
    framed(&protos.iter().map(Proto::encode).collect::<Vec<_>>())
}
