"""How a part is taken, laid down and taken again: grasps, placements, regrasps, and the way of a hand to a grasp."""
