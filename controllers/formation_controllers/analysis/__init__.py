"""Analysis of formations and gains, apart from driving a robot.

- `formation_model`: every matrix of the formation model (9), (10) at an instant
- `linearisation`: that model about the straight motion
- `gain_conditions`: which conditions of Theorem 1 gains satisfy, (39) to (42) and Remark 2
- `region_of_attraction`: the initial errors for which the theorem promises something, (52)

No law needs it but `lqg`, which is designed on the linearised model.
"""
