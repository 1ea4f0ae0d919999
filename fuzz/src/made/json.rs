/// A hand-written scenario with everything that such files can hold.
pub const HAND: &str = r#"{"format": "reactsim-scenario-v1", "id": "hand", "intent": "all", "av": "av",
"agents": [{"id": "b", "length": 4.5, "width": 1.9, "motion": {"at": [10, 0], "speed": 10, "frames": [3, 60]}},
{"id": "av", "length": 4.8, "width": 2.0, "motion": {"at": [40, 0], "heading": 0.1, "speed": 10, "past": {"acceleration": 1, "curvature": 0.01}}},
{"id": "cone", "kind": "other", "length": 0.5, "width": 0.5, "motion": {"at": [40, 5]}}],
"tracks_to_predict": ["b"], "objects_of_interest": ["av"],
"map": {"lanes": [{"id": "1", "speed_limit": 13.9, "path": {"at": [-50, 0], "pieces": [{"length": 10}, {"length": 3, "curvature": 0.05}]},
"successors": ["2"], "left": [{"lane": "3"}]},
{"id": "2", "kind": "connector", "points": [[80, 20], [90, 40]], "polygon": [[78, 20], [82, 20], [92, 40], [88, 40]]},
{"id": "3", "class": "freeway", "points": [[-50, 3.5], [50, 3.5]], "half_width": 2}, {"id": "4", "points": [], "predecessors": ["1"]}],
"road_edges": [{"points": [[-50, -2], [50, -2]]}], "road_lines": [{"paint": 2, "points": [[-50, 2], [50, 2]]}],
"stop_lines": [{"kind": "yield", "lane": "3", "at": [20.3, 4]}], "crosswalks": [[[60, -5], [63, -5], [63, 8]]],
"speed_bumps": [[[0, 0], [1, 0], [1, 1]]], "driveways": [[[0, 9], [1, 9], [1, 10]]], "intersections": [[[70, 0], [90, 0], [90, 40]]],
"drivable_area": [{"exterior": [[-50, -2], [90, -2], [90, 50], [-50, 50]], "holes": [[[0, 20], [5, 20], [5, 25]]]}]},
"lights": [{"lane": "1", "stop_point": [45, 0], "phases": [{"state": "go", "seconds": 4}, {"seconds": 1}, {"state": "stop", "seconds": 1}]}],
"deviation": {"category": "lateral", "pieces": [{"seconds": 3, "shift": 2, "acceleration": -1}]}}
"#;
