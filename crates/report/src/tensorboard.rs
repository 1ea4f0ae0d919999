//! The log of a training as a TensorBoard event file.
//!
//! The file is a sequence of records as in TFRecord; each is a message `Event` of TensorFlow's `event.proto`
//! (<https://github.com/tensorflow/tensorboard>, `tensorboard/compat/proto`), of which only scalars are used
//! here.

use reactsim_formats::tf_record;
use reactsim_formats::wire::Message;
use reactsim_nn::training::Row;

/// Name of the event file; TensorBoard recognises its beginning.
pub const EVENTS: &str = "events.out.tfevents.0.reactsim";
/// Version of event files.
const FILE_VERSION: &str = "brain.Event:2";

/// Tags of the fields of `Event`, of `Summary` and of `Summary.Value`.
mod tag {
    pub(super) const WALL_TIME: u32 = 1;
    pub(super) const STEP: u32 = 2;
    pub(super) const FILE_VERSION: u32 = 3;
    pub(super) const SUMMARY: u32 = 5;
    pub(super) const VALUE: u32 = 1;
    pub(super) const NAME: u32 = 1;
    pub(super) const SIMPLE_VALUE: u32 = 2;
}

/// Returns the first record of an event file.
pub fn header() -> Vec<u8> {
    let mut event = Message::default();
    event.bytes(tag::FILE_VERSION, FILE_VERSION);
    tf_record(&event.into_bytes())
}

/// Returns the record of a row of the log. Tags are `train/…`, `validation/…` and `closed_loop/…`; wall times
/// are seconds since the training began.
pub fn record(row: &Row) -> Vec<u8> {
    let mut summary = Message::default();
    let mut put = |group: &str, name: &str, number: f64| {
        let mut value = Message::default();
        value.bytes(tag::NAME, format!("{group}/{name}"));
        // Zero is what a missing number means.
        if number as f32 != 0.0 {
            value.float(tag::SIMPLE_VALUE, number as f32);
        }
        summary.bytes(tag::VALUE, value.into_bytes());
    };
    let wall = match row {
        Row::Step(row) => {
            row.loss.into_iter().for_each(|loss| put("train", "loss", loss));
            put("train", "learning_rate", row.learning_rate);
            put("train", "gradient_norm", row.gradient_norm);
            row.metrics.iter().for_each(|(name, number)| put("train", name, *number));
            put("train", "scenarios_per_second", row.wall.per_second);
            put("train", "memory_bytes", row.wall.memory as f64);
            row.wall
        }
        Row::Validation(row) => {
            put("validation", "loss", row.loss);
            row.metrics.iter().for_each(|(name, number)| put("validation", name, *number));
            row.closed_loop.iter().for_each(|(name, number)| put("closed_loop", name, *number));
            row.wall
        }
    };
    let mut event = Message::default();
    if wall.seconds != 0.0 {
        event.double(tag::WALL_TIME, wall.seconds);
    }
    if row.step() != 0 {
        event.int64(tag::STEP, row.step() as i64);
    }
    event.bytes(tag::SUMMARY, summary.into_bytes());
    tf_record(&event.into_bytes())
}

#[cfg(test)]
mod tests {
    use reactsim_nn::training::{StepRow, Wall};

    use super::*;

    /// Bytes written down from the definition of the messages and of the records.
    #[test]
    fn records_have_the_published_layout() {
        let header = header();
        let payload = b"\x09\0\0\0\0\0\0\0\0\x1a\x0dbrain.Event:2";
        assert_eq!(header[..8], (payload[9..].len() as u64).to_le_bytes());
        assert_eq!(header[12..header.len() - 4], payload[9..]);
        let row = Row::Step(StepRow {
            step: 3,
            epoch: 0.5,
            loss: Some(1.5),
            learning_rate: 0.25,
            gradient_norm: 2.0,
            items: 1.0,
            samples: 1,
            metrics: [("accuracy".to_owned(), 0.75)].into(),
            wall: Wall { seconds: 2.0, per_second: 4.0, memory: 1024 },
        });
        let record = record(&row);
        let event = &record[12..record.len() - 4];
        let begin = b"\x09\0\0\0\0\0\0\0\x40\x10\x03\x2a";
        assert_eq!(event[..begin.len()], *begin);
        let mut summary = &event[begin.len() + 2..];
        assert_eq!(
            summary.len(),
            usize::from(event[begin.len()] & 0x7f) | usize::from(event[begin.len() + 1]) << 7
        );
        let mut found = Vec::new();
        while let [0x0a, length, rest @ ..] = summary {
            let (value, after) = rest.split_at(usize::from(*length));
            let [0x0a, length, name @ ..] = value else { panic!("{value:?}") };
            let (name, number) = name.split_at(usize::from(*length));
            let [0x15, number @ ..] = number else { panic!("{number:?}") };
            let number = f32::from_le_bytes(number.try_into().unwrap());
            found.push((str::from_utf8(name).unwrap(), number));
            summary = after;
        }
        let expected = [
            ("train/loss", 1.5),
            ("train/learning_rate", 0.25),
            ("train/gradient_norm", 2.0),
            ("train/accuracy", 0.75),
            ("train/scenarios_per_second", 4.0),
            ("train/memory_bytes", 1024.0),
        ];
        assert_eq!(found, expected);
    }
}
