"""The action FollowJointTrajectory: goals, tolerances, stops."""
