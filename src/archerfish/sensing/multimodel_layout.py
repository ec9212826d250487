"""What the numbers of the multimodel observation are, block by block, in order."""


def multimodel_layout(moves: int, sights: int, bearings: int, distances: int, habits: int) -> list[tuple[str, int]]:
    """Return name and size of the blocks of an observation, before it is normalised.

    Args:
      moves: of gimbal and command that are remembered.
      sights: that are remembered.
      bearings: Legendre coefficients of a second of the azimuth.
      distances: the same of the distance.
      habits: the same of three seconds of the azimuth.
    """
    return [
        ("2 × (aim − gimbal), pitch and yaw", 2),
        ("tanh(33.3 × (aim − gimbal)), pitch and yaw", 2),
        ("2 × aim, pitch and yaw", 2),
        ("(distance − 3 m) / 2", 1),
        ("0.3 / distance", 1),
        ("2 × (aim − where the command would come to rest)", 2),
        ("tanh(33.3 × (aim − where the command would come to rest))", 2),
        ("2 × (command − gimbal), a decision ago and now", 4),
        ("10 × moves of the gimbal, oldest first", 2 * moves),
        ("2 × moves of the command, oldest first", 2 * moves),
        ("age of the sight and of the feedback / 50 ms", 2),
        ("time since the first sight", 1),
        ("tanh(4 × time since the first sight)", 1),
        ("fast tracker's speed across the line of sight: 5 ×, tanh(3 ×), tanh(10 ×)", 3),
        ("the same along the line of sight", 3),
        ("100 × (last sight's yaw − estimate's)", 1),
        ("20 × distance × (yaw of the last sights − estimate's), oldest first", sights),
        ("tanh(2.5 ×) of the same", sights),
        ("4 × (distances of the last sights − estimate's), oldest first", sights),
        ("10 × distance × Legendre coefficients of a second of the yaw, less the estimate's", bearings),
        ("2 × Legendre coefficients of a second of the distance, less the estimate's", distances),
        ("10 × distance × Legendre coefficients of three seconds of the yaw, less the estimate's", habits),
        ("probabilities that the target stands, drives on, has turned back", 3),
        ("0.3 × log odds that it stands", 1),
        ("0.3 × log odds that it has turned back rather than drives on", 1),
        ("speed across the line of sight if it drives on: 2 ×, tanh(3 ×), tanh(10 ×)", 3),
        ("2 × speed along the line of sight if it drives on", 1),
        ("2 × speeds across and along the line of sight if it has turned back", 2),
        ("10 × where it is if it stands, less the estimate, across and along", 2),
        ("slow tracker's place less the fast one's, across: 20 ×, tanh(40 ×)", 2),
        ("5 × slow tracker's velocity less the fast one's, across and along", 2),
        ("5 × slow tracker's speed across the line of sight", 1),
        ("10 × (slow tracker's intercept − aim), pitch and yaw", 2),
        ("10 × distance × (slow tracker's intercept − aim), yaw", 1),
        ("slow tracker's mean squared innovation: log, tanh(÷ 4)", 2),
    ]
