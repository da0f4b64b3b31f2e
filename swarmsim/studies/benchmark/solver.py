"""The solvers of OR-tools: routes of vehicles, and large linear programmes."""

from __future__ import annotations

from ortools.constraint_solver import pywrapcp, routing_enums_pb2


def routing(matrix: list[list[int]], routes: list[list[int]], span: int, looks: int) -> list[list[int]]:
    """Better routes through the same nodes, by guided local search, which looks so often at what it has.

    Looks are counted, not seconds, so that the same routes come out on any machine.

    `matrix` holds the costs between nodes: the starts of the routes, in order, then stops, then the common end. The
    cost is that of all arcs, plus `span` times that of the dearest route.
    """
    count, end = len(routes), len(matrix) - 1
    manager = pywrapcp.RoutingIndexManager(len(matrix), count, list(range(count)), [end] * count)
    model = pywrapcp.RoutingModel(manager)
    transit = model.RegisterTransitMatrix(matrix)
    model.SetArcCostEvaluatorOfAllVehicles(transit)
    model.AddDimension(transit, 0, sum(map(max, matrix)), True, "way")
    model.GetDimensionOrDie("way").SetGlobalSpanCostCoefficient(span)
    asked = pywrapcp.DefaultRoutingSearchParameters()
    asked.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    asked.time_limit.FromSeconds(3600)  # without one, it warns; looks come first
    model.CloseModelWithParameters(asked)
    left = iter(range(looks))
    model.AddSearchMonitor(model.solver().CustomLimit(lambda: next(left, None) is None))
    given = model.ReadAssignmentFromRoutes(routes, True)
    found = model.SolveFromAssignmentWithParameters(given, asked) or given
    better = []
    for robot in range(count):
        node, way = found.Value(model.NextVar(model.Start(robot))), []
        while not model.IsEnd(node):
            way.append(manager.IndexToNode(node))
            node = found.Value(model.NextVar(node))
        better.append(way)
    return better
